"""Observers: the base class with its rules, the switched PI observer, and others."""

from dryfric_control.observer.base import Observer as Observer
from dryfric_control.observer.certificate import (
    Certificate as Certificate,
)
from dryfric_control.observer.certificate import (
    CertificateError as CertificateError,
)
from dryfric_control.observer.closed_loop import (
    filter_reference as filter_reference,
)
from dryfric_control.observer.closed_loop import (
    observed_loop as observed_loop,
)
from dryfric_control.observer.closed_loop import (
    score_estimate as score_estimate,
)
from dryfric_control.observer.closed_loop import (
    simulate_observed_loop as simulate_observed_loop,
)
from dryfric_control.observer.closed_loop import (
    switch_delays as switch_delays,
)
from dryfric_control.observer.design import (
    ObserverDesign as ObserverDesign,
)
from dryfric_control.observer.design import (
    design_pi_observer as design_pi_observer,
)
from dryfric_control.observer.error_model import (
    ObserverWarning as ObserverWarning,
)
from dryfric_control.observer.extended_state import (
    ExtendedStateObserver as ExtendedStateObserver,
)
from dryfric_control.observer.extended_state import (
    extended_state_observer as extended_state_observer,
)
from dryfric_control.observer.hybrid_filter import (
    HybridFilter as HybridFilter,
)
from dryfric_control.observer.hybrid_filter import (
    hybrid_filter as hybrid_filter,
)
from dryfric_control.observer.monte_carlo import (
    monte_carlo as monte_carlo,
)
from dryfric_control.observer.runtime import (
    ObserverStepper as ObserverStepper,
)
from dryfric_control.observer.runtime import observe as observe
from dryfric_control.observer.runtime import pi_observer as pi_observer

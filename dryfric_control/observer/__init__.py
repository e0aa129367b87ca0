"""The switched PI observer: design, certificate, and the observer at work."""

from dryfric_control.observer.certificate import Certificate, CertificateError
from dryfric_control.observer.closed_loop import (
    filter_reference,
    observed_loop,
    simulate_observed_loop,
)
from dryfric_control.observer.design import ObserverDesign, design_pi_observer
from dryfric_control.observer.hybrid_filter import hybrid_filter
from dryfric_control.observer.monte_carlo import monte_carlo
from dryfric_control.observer.runtime import ObserverStepper, observe, pi_observer
from dryfric_control.observer.score import score_estimate, switch_delays
from dryfric_control.observer.weights import ObserverWarning

__all__ = [
    "Certificate",
    "CertificateError",
    "ObserverDesign",
    "ObserverStepper",
    "ObserverWarning",
    "design_pi_observer",
    "filter_reference",
    "hybrid_filter",
    "monte_carlo",
    "observe",
    "observed_loop",
    "pi_observer",
    "score_estimate",
    "simulate_observed_loop",
    "switch_delays",
]

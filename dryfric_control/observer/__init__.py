"""The switched PI observer: design, certificate, and the observer at work."""

from dryfric_control.observer.certificate import Certificate, CertificateError
from dryfric_control.observer.closed_loop import (
    ObservedLoop,
    filter_reference,
    observed_loop,
    simulate_observed_loop,
)
from dryfric_control.observer.design import ObserverDesign, design_pi_observer, load_design
from dryfric_control.observer.hybrid_filter import HybridFilter, HybridStepper, hybrid_filter
from dryfric_control.observer.monte_carlo import MonteCarlo, monte_carlo
from dryfric_control.observer.runtime import (
    Estimate,
    ObserverResponse,
    ObserverStepper,
    observe,
    pi_observer,
)
from dryfric_control.observer.score import EstimateScore, score_estimate, switch_delays
from dryfric_control.observer.weights import ObserverWarning

__all__ = [
    "Certificate",
    "CertificateError",
    "Estimate",
    "EstimateScore",
    "HybridFilter",
    "HybridStepper",
    "MonteCarlo",
    "ObservedLoop",
    "ObserverDesign",
    "ObserverResponse",
    "ObserverStepper",
    "ObserverWarning",
    "design_pi_observer",
    "filter_reference",
    "hybrid_filter",
    "load_design",
    "monte_carlo",
    "observe",
    "observed_loop",
    "pi_observer",
    "score_estimate",
    "simulate_observed_loop",
    "switch_delays",
]

"""Searches that several tests of the diagnosis begin from."""

import pytest
from diagnosis_cases import believed, record
from truth import make_machine

from dryfric_control.diagnosis.likelihood_search import Search


@pytest.fixture(scope="module")
def lopsided():
    """A search on a record with an asymmetry and a peak, and the fit without either."""
    case = make_machine(2, ("coulomb_asymmetry", "stribeck"))[0]
    search = Search(believed(case), [record(case)])
    return search, search.fit(search.believed, ())

"""Tables of results for papers, spreadsheets and pages."""

import csv
import io
import math
import re

import pytest

import dryfric_control as dfc
from dryfric_control.result_table import Quantity, format_table, siunitx_unit

ROWS = [
    ["mass", Quantity(2.41234, 0.0312, "kg")],
    ["slow_1 & more", Quantity(1.2345e-6, 3.4e-9, "m")],
    ["level", Quantity(2345.0, 347.0, "N")],
    ["share", Quantity(0.3, math.inf)],
    ["sum|x", "none"],
]


def test_numbers_have_the_digits_of_their_errors():
    page = format_table(("name", "value"), ROWS, "markdown").splitlines()
    assert page[0] == "| name | value |" and page[1] == "| --- | --- |"
    assert [line.split(" | ")[1].removesuffix(" |") for line in page[2:]] == [
        "2.412 ± 0.031 kg", "(1.2345 ± 0.0034)·10⁻⁶ m", "2340 ± 350 N", "0.3 (undetermined)", "none",
    ]  # fmt: skip
    paper = format_table(("name", "value"), ROWS, "latex")
    assert re.findall(r"\\(?:qty|num)\{.*?\}(?:\{.*?\})?", paper) == [
        r"\qty{2.412(31)}{\kilogram}", r"\qty{1.2345(34)e-6}{\metre}",
        r"\qty{2340(350)}{\newton}", r"\num{0.3}",
    ]  # fmt: skip
    assert r"slow\_1 \& more" in paper and paper.count("{") == paper.count("}")
    rows = list(csv.reader(io.StringIO(format_table(("name", "value"), ROWS, "csv"))))
    assert rows[0] == ["name", "value", "value std. error", "value unit"]
    assert rows[1] == ["mass", "2.41234", "0.0312", "kg"] and rows[5] == ["sum|x", "none", "", ""]
    with pytest.raises(ValueError, match="form must be one of latex, csv, markdown"):
        format_table(("name",), [], "html")


@pytest.mark.parametrize(
    ("unit", "macros"),
    [
        ("N s/m", r"\newton\second\per\metre"), ("kg m^2", r"\kilogram\metre\squared"),
        ("N m s^2/rad^2", r"\newton\metre\second\squared\per\radian\squared"), ("1/s", r"\per\second"),
        ("1/(m s)", r"\per\metre\per\second"), ("counts/V", "counts/V"), ("%", r"\percent"),
    ],
)  # fmt: skip
def test_units_are_those_of_siunitx(unit, macros):
    assert siunitx_unit(unit) == macros


def test_a_fit_and_a_cause_as_tables():
    axis = dfc.datasets.belt_stage_axis()
    with pytest.warns(dfc.FitWarning):
        fitted = dfc.fit(axis, dfc.datasets.belt_stage(), free=("mass",), starts=1)
    name, value, error, unit, low, high = list(csv.reader(io.StringIO(fitted.table("csv"))))[1]
    assert (name, unit) == ("mass", "kg") and float(error) == fitted.standard_errors["mass"]
    assert float(low) < float(value) == fitted.parameters["mass"] < float(high)

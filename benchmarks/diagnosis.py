"""How often a diagnosis names the hidden cause, beside the best existing way (10 s a record).

    python benchmarks/diagnosis.py [--seeds 20] [--first 0] [--conditions exact off coarse short
                                   noisy 10-bit decimated jitter outliers machine]
                                   [--effects bias_force ...] [--jobs 2] [--store FILE]
    python benchmarks/diagnosis.py --summary --store FILE
    python benchmarks/diagnosis.py --conditions machine --effects machine clean --seeds 5

The blind conditions are *exact* to *short*.  *noisy* to *outliers* are the records of
*exact* as a poor logger writes them down; *machine* is three runs of one machine
with two to four hidden effects and base parameters 20 % off (tests/truth/bench.py,
recorder.py).  `--conditions blind` and `--conditions recorded` name these groups.

The independent bench of tests/truth hides one effect, a pair, none, or one that
no candidate describes in closed-loop records of random axes; `diagnose` and the
one-cause least squares of diagnosis_baseline.py get the same records in the
same run.  Each result is one line of JSON in the store, and a run that was
stopped goes on from there.  Every figure printed comes from the store.

What counts: a record is named right if the causes that are not wrong base
parameters are exactly the hidden ones (for a hidden base parameter: it, and no
other kind); an effect that gives the very same record on that axis counts as
the hidden one, and as much for the peer.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import time
import traceback
import warnings
from argparse import Namespace
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from harness import ROOT, Table, import_from, parser_of, percent_of
from joblib import Parallel, delayed
from tqdm import tqdm

import_from("tests")

import diagnosis_baseline as peer  # noqa: E402
import pictures  # noqa: E402
import truth  # noqa: E402
from diagnosis_cases import (  # noqa: E402
    BASE,
    believed,
    foreign,
    named_right,
    parameter_errors,
    record,
    right_or_alternative,
)

import dryfric_control as dfc  # noqa: E402

Row = dict[str, Any]
Key = tuple[str, str, int]  # condition, effect or kind, seed

CLEAN, PAIR, OUTSIDE, MACHINE = "clean", "pair", "outside", "machine"
GROUPS = {"blind": truth.CONDITIONS, "recorded": truth.RECORDERS}
CONDITIONS = (*truth.CONDITIONS, *truth.RECORDERS, MACHINE)
FLAGGED = ("partly explained", "unexplained")
# A clean record is quick and its rate has to be known to 2 %.
CLEAN_PER_SEED = 3


def cases_of(key: Key) -> tuple[truth.Case, ...]:
    """The records of a key: one, or those of one machine."""
    condition, what, seed = key
    if condition == MACHINE:
        return truth.make_machine(seed, 0 if what == CLEAN else None)
    if what == CLEAN:
        return (truth.make_null(seed, condition),)
    if what == PAIR:
        return (truth.make_pair(seed, condition),)
    if what == OUTSIDE:
        return (truth.make_outside(seed, condition),)
    return (truth.make_case(what, seed, condition),)


def run(key: Key, code: str) -> Row:
    """Diagnose the records of one key; let the peer name the cause of a blind one."""
    from dryfric_control.diagnosis.diagnose import diagnose

    condition, what, seed = key
    cases = cases_of(key)
    case = cases[0]
    row: Row = {
        "condition": condition, "what": what, "seed": seed, "code": code,
        "truth": case.truth, "twins": {k: list(v) for k, v in case.twins.items()},
        "visibility": case.visibility, "duration": float(case.t[-1]),
    }  # fmt: skip
    if condition in peer.GATES:
        start = time.perf_counter()
        features = peer.features(case.t, case.u, case.x, case.believed)
        row["peer"] = peer.decide(features, peer.GATES[condition])
        row["peer_seconds"] = time.perf_counter() - start
        row["peer_exact"] = peer.decide(features, peer.GATES["exact"])
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", dfc.RecordWarning)  # spoiled on purpose
            axis, measured = believed(case), [record(c) for c in cases]
        several = "known" in inspect.signature(diagnose).parameters
        found = diagnose(axis, measured if several and len(cases) > 1 else measured[0], jobs=1)
    except Exception:  # a run of hours must not end with one record
        return row | {
            "error": traceback.format_exc(), "seconds": time.perf_counter() - start,
            "verdict": "error", "causes": [], "alternatives": [], "errors": {}, "after": None,
        }  # fmt: skip
    return row | {
        "seconds": time.perf_counter() - start,
        "verdict": found.verdict,
        "causes": [cause.effect for cause in found.causes],
        "alternatives": [list(cause.alternatives) for cause in found.causes],
        "parameters": {cause.effect: cause.parameters for cause in found.causes},
        "errors": parameter_errors(case, found),
        "before": found.gain.before,
        "after": found.gain.after,
        "floor": found.gain.floor,
        "unexplained": found.unexplained.fraction,
    }


def warm() -> None:
    """Compile what the runs need, so that no record's time holds it."""
    run(("short", "bias_force", 0), "")


def _code() -> str:
    """Fingerprint of the package, to tell rows of different versions apart."""
    digest = hashlib.sha256()
    for path in sorted((ROOT / "dryfric_control").rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def keys(options: Namespace) -> list[Key]:
    """All records of a run."""
    chosen = [name for given in options.conditions for name in GROUPS.get(given, (given,))]
    kinds = {
        **dict.fromkeys(truth.CONDITIONS, (*truth.EFFECTS, CLEAN, PAIR, OUTSIDE)),
        **dict.fromkeys(truth.RECORDERS, (*truth.EFFECTS, CLEAN)),
        MACHINE: (MACHINE, CLEAN),
    }
    found = []
    for condition in dict.fromkeys(chosen):
        known = kinds[condition]
        if options.effects:
            # Effects that came later are made where they are named.
            added = truth.ADDED if condition != MACHINE else ()
            known = [what for what in (*known, *added) if what in options.effects]
        for what in known:
            count = options.seeds * (CLEAN_PER_SEED if what == CLEAN else 1)
            seeds = range(options.first, options.first + count)
            found += [(condition, what, seed) for seed in seeds]
    return found


def load(store: Path) -> dict[Key, Row]:
    """Rows of a store; a last line that was cut off is left out."""
    rows: dict[Key, Row] = {}
    if store.exists():
        for line in store.read_text(encoding="utf-8").splitlines():
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                continue
            rows[row["condition"], row["what"], row["seed"]] = row
    return rows


def collect(todo: list[Key], store: Path, jobs: int) -> None:
    """Run what the store lacks, and write each result at once."""
    done = load(store)
    left = [key for key in todo if key not in done]
    if not left:
        return
    code = _code()
    warm()
    store.parent.mkdir(parents=True, exist_ok=True)
    results = Parallel(n_jobs=jobs, return_as="generator_unordered")(
        delayed(run)(key, code) for key in left
    )
    with store.open("a", encoding="utf-8") as file:
        if file.tell() and not store.read_text(encoding="utf-8").endswith("\n"):
            file.write("\n")
        for row in tqdm(results, total=len(left), desc="diagnosis", unit="record", disable=None):
            file.write(json.dumps(row, allow_nan=True) + "\n")
            file.flush()


# -- marks -------------------------------------------------------------------------


def right(row: Row) -> bool:
    """Whether the diagnosis named the hidden cause and nothing else."""
    return named_right([*row["truth"]], row["twins"], row["causes"])


def or_alternative(row: Row) -> bool:
    """The same, or the hidden cause is among the alternatives."""
    return right_or_alternative([*row["truth"]], row["twins"], row["causes"], row["alternatives"])


def peer_right(row: Row, field: str = "peer") -> bool:
    """Whether the peer named the hidden cause."""
    return named_right([*row["truth"]], row["twins"], [row[field]] if row[field] else [])


def answer(row: Row) -> str:
    """First cause that is no wrong base parameter, else the first, else the verdict."""
    causes = row["causes"]
    others = foreign(causes)
    name = others[0] if others else causes[0] if causes else ""
    if row["what"] in row["causes"] and row["what"] in BASE and not others:
        name = row["what"]
    more = "" if len(others) < 2 else f"+{len(others) - 1}"
    return f"{name}{more}" if name else row["verdict"]


def accused(row: Row) -> bool:
    """Whether a clean record is accused; off, base parameters may be mended."""
    wrong_base = row["condition"] in ("off", MACHINE)
    return bool(foreign(row["causes"]) if wrong_base else row["causes"])


def false_causes(row: Row) -> list[str]:
    """Named causes that are neither hidden, nor a twin, nor hold a hidden one beside them."""
    allowed = {*row["truth"]}.union(*(row["twins"].get(slug, ()) for slug in row["truth"]))
    base = () if row["condition"] in ("off", MACHINE) or foreign(row["truth"]) else BASE
    return [
        cause
        for cause, alternatives in zip(row["causes"], row["alternatives"], strict=True)
        if cause not in allowed and (cause in base or cause not in BASE)
        and not allowed & _each(alternatives)
    ]  # fmt: skip


def all_found(row: Row) -> bool:
    """Whether each hidden cause, or its twin, is named or held as an alternative."""
    named = {*row["causes"]}.union(*map(_each, row["alternatives"]))
    return all({slug, *row["twins"].get(slug, ())} & named for slug in row["truth"])


def _each(alternatives: list[str]) -> set[str]:
    """The effects of alternatives; of those that only together do the same, each."""
    return {slug for one in alternatives for slug in one.split("+")}


# -- report ------------------------------------------------------------------------

Mark = Callable[[Row], bool]
#: Effects, alone in a record.
SINGLE = (*truth.EFFECTS, *truth.ADDED)
HIDDEN = (*SINGLE, MACHINE)


def figures(condition: str) -> list[tuple[str, tuple[str, ...], Mark | None, Mark | None]]:
    """Text, kinds of records, and marks of the diagnosis and of the peer, of each rate."""
    off = condition == "off"
    base_exact = [
        ("  believing its parameters, gates of exact", SINGLE, None, exact_gates(peer_right)),
    ]
    clean_exact = [
        ("  base parameters corrected", (CLEAN,), lambda r: bool(r["causes"]), None),
        ("  gates of exact", (CLEAN,), None, exact_gates(peer_accused)),
    ]
    return [
        ("named right", HIDDEN, right, peer_right),
        *(base_exact if off else ()),
        ("named right or in the alternatives", SINGLE, or_alternative, None),
        ("all causes found, named or as alternatives", HIDDEN, all_found, None),
        ("  a right base parameter accused beside", () if off else SINGLE, base_accused, None),
        ('verdict "explained"', HIDDEN, lambda r: r["verdict"] == "explained", None),
        ("with a false cause", (*HIDDEN, CLEAN), lambda r: bool(false_causes(r)), None),
        ("clean records accused", (CLEAN,), accused, peer_accused),
        *(clean_exact if off else ()),
        ('  "nothing to find"', (CLEAN,), lambda r: r["verdict"] == "nothing to find", None),
        ("outside the catalogue, flagged", (OUTSIDE,), lambda r: r["verdict"] in FLAGGED, None),
        ("  and no cause named", (OUTSIDE,), lambda r: not r["causes"], lambda r: not r["peer"]),
        ("both of a pair, nothing else", (PAIR,), right, None),
        (
            "  one of a pair, at least", (PAIR,),
            lambda r: bool({*r["truth"]} & {*r["causes"]}), lambda r: r["peer"] in r["truth"],
        ),
    ]  # fmt: skip


def report(rows: list[Row], condition: str) -> None:
    """Print everything about one condition."""
    with_peer = "peer" in rows[0]
    print(f"\n{condition}: what was named, by truth" + " [best existing way]" * with_peer)
    for what in (*SINGLE, CLEAN, OUTSIDE):
        if group := [r for r in rows if r["what"] == what]:
            theirs = Counter(r["peer"] or "nothing" for r in group if with_peer)
            beside = f"   [{_told(theirs)}]" if with_peer else ""
            print(f"  {what:20s} {_told(Counter(map(answer, group)))}{beside}")
    for row in rows:
        if row["what"] in (PAIR, MACHINE):
            print(f"  {row['what']} {row['seed']:3d}  {' + '.join(row['truth']):60s} "
                  f"{' + '.join(row['causes']) or row['verdict']}"
                  f"{'' if right(row) else '   <- wrong'}")  # fmt: skip
    table = Table({condition: "46s", "diagnosis": "27s", "best existing way": "27s"})
    for text, kinds, ours, theirs in figures(condition):
        if group := [r for r in rows if r["what"] in kinds]:
            table.row(text, *(
                percent_of([mark(r) for r in group]) if mark else "-"
                for mark in (ours, theirs if with_peer else None)
            ))  # fmt: skip
    single = [r for r in rows if r["what"] in SINGLE]
    for text, cell in numbers(single, [r for r in rows if r["what"] == PAIR]):
        table.row(text, cell, "-")
    seconds = [r["seconds"] for r in rows]
    theirs = f"{np.median([r['peer_seconds'] for r in rows]):.2f}" if with_peer else "-"
    table.row(
        "seconds a record, median (largest)",
        f"{np.median(seconds):.1f} ({max(seconds):.1f})",
        theirs,
    )
    for row in rows:
        if "error" in row:
            print(f"  ERROR {row['what']} seed {row['seed']}: {row['error'].splitlines()[-1]}")


def base_accused(row: Row) -> bool:
    """Whether a base parameter that is right is named beside an effect."""
    return not {*row["truth"]} & {*BASE} and bool({*row["causes"]} & {*BASE})


def peer_accused(row: Row, field: str = "peer") -> bool:
    """Whether the peer accuses a clean record; off, base parameters may be corrected."""
    name = row[field]
    return bool(foreign([name]) if name and row["condition"] == "off" else name)


def exact_gates(mark: Callable[[Row, str], bool]) -> Mark:
    """A mark of the peer with the gates that are for exact parameters."""
    return lambda row: mark(row, "peer_exact")


def _told(count: Counter[str]) -> str:
    return ", ".join(f"{name} {k}" for name, k in count.most_common())


def numbers(single: list[Row], pairs: list[Row]) -> list[tuple[str, str]]:
    """Text and value of what is no rate: alternatives, parameters, held-out errors."""
    if not single:
        return []
    found = []
    rates: dict[str, list[bool]] = {}
    each: dict[str, list[float]] = {}
    for row in single:
        rates.setdefault(row["what"], []).append(right(row))
        for name, error in row["errors"].items() if right(row) else ():
            each.setdefault(name, []).append(error)
    low = min(rates, key=lambda what: np.mean(rates[what]))
    found.append(("  worst effect", f"{low} {100.0 * np.mean(rates[low]):.0f} %"))
    count = [len(a) for r in single for c, a in zip(r["causes"], r["alternatives"], strict=True)
             if c not in BASE]  # fmt: skip
    found.append(("  alternatives of a cause, mean", f"{np.mean(count):.2f}" if count else "-"))
    if each:
        errors = [e for some in each.values() for e in some]
        found.append(
            (
                "parameter error, median (90 % quantile)",
                f"{100.0 * np.median(errors):.2g} % ({100.0 * np.quantile(errors, 0.9):.2g} %)",
            )
        )
        medians = sorted(((float(np.median(e)), name) for name, e in each.items()), reverse=True)
        found += [(f"  {name}", f"{100.0 * error:.2g} %") for error, name in medians[:4]]
    both = [e for r in pairs if right(r) for e in r["errors"].values()]
    if both:
        found.append(("  in pairs", f"{100.0 * np.median(both):.2g} %"))
    ratios = np.array([r["after"] / r["floor"] for r in single if r["after"] is not None])
    if ratios.size:
        found.append(("held-out error over its floor, median", f"{np.median(ratios):.3f}"))
        found.append(("  share of records above 1.15", f"{100.0 * np.mean(ratios > 1.15):.1f} %"))
    return found


def wrong(rows: list[Row]) -> None:
    """List every record that was not answered as it should be."""
    for row in rows:
        if row["what"] == CLEAN:
            bad = accused(row)
        elif row["what"] == OUTSIDE:
            bad = row["verdict"] not in FLAGGED
        else:
            bad = not right(row)
        if bad:
            told = "; ".join(
                c + (f" (or {', '.join(a)})" if a else "")
                for c, a in zip(row["causes"], row["alternatives"], strict=True)
            )
            true = " + ".join(row["truth"]) or "clean"
            print(f"  {row['condition']:6s} {true} seed {row['seed']}: {row['verdict']}; {told}")


def main() -> None:
    """Run what is missing, then print one table per condition."""
    kinds = (*SINGLE, CLEAN, PAIR, OUTSIDE, MACHINE)
    parser = parser_of(__doc__, {
        "--seeds": (20, "records per effect"),
        "--first": (0, "the first seed"),
        "--jobs": (2, "records at the same time"),
        "--store": (Path("diagnosis.jsonl"), "results, a line each"),
        "--summary": (False, "only print what the store holds"),
        "--plot": (Path, "confusion matrix of the effects, of all conditions run"),
    })  # fmt: skip
    parser.add_argument("--conditions", nargs="+", default=CONDITIONS,
                        choices=[*CONDITIONS, *GROUPS])  # fmt: skip
    parser.add_argument("--effects", nargs="+", choices=kinds, help="default: all")
    options = parser.parse_args()
    todo = keys(options)
    if not options.summary:
        collect(todo, options.store, options.jobs)
    stored = load(options.store)
    rows = list(stored.values()) if options.summary else [stored[k] for k in todo if k in stored]
    versions = Counter(row["code"] for row in rows)
    print(f"{len(rows)} records; fingerprint of the package: {_told(versions)}")
    if len(versions) > 1:
        print("BEWARE: these rows come from different versions of the package")
    for condition in CONDITIONS:
        some = [row for row in rows if row["condition"] == condition]
        if some:
            report(some, condition)
    print("\nanswered wrongly:")
    wrong(rows)
    if options.plot:
        some = [row for row in rows if row["what"] in (*SINGLE, CLEAN)]
        under = ", ".join(dict.fromkeys(row["condition"] for row in some))
        pictures.confusion(
            [(row["what"], answer(row)) for row in some], (*SINGLE, CLEAN),
            f"{len(some)} simulated records, condition {under}", options.plot,
        )  # fmt: skip


if __name__ == "__main__":
    main()

"""How often a diagnosis names the hidden cause, beside the best existing way.

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

import argparse
import hashlib
import inspect
import json
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[1]
for folder in (ROOT, ROOT / "tests", ROOT / "benchmarks"):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

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


def keys(options: argparse.Namespace) -> list[Key]:
    """All records of a run."""
    kinds = {
        **dict.fromkeys(truth.CONDITIONS, (*truth.EFFECTS, CLEAN, PAIR, OUTSIDE)),
        **dict.fromkeys(truth.RECORDERS, (*truth.EFFECTS, CLEAN)),
        MACHINE: (MACHINE, CLEAN),
    }
    return [
        (condition, what, seed)
        for condition in dict.fromkeys(
            name for given in options.conditions for name in GROUPS.get(given, (given,))
        )
        for what in (
            *kinds[condition],
            *(truth.ADDED if options.effects and condition != MACHINE else ()),
        )
        if not options.effects or what in options.effects
        for seed in range(
            options.first,
            options.first + options.seeds * (CLEAN_PER_SEED if what == CLEAN else 1),
        )
    ]


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


def share(rows: Iterable[Row], mark: Callable[[Row], bool]) -> str:
    """Rate as counts and per cent."""
    marks = [mark(row) for row in rows]
    return f"{sum(marks)}/{len(marks)} = {100.0 * np.mean(marks):.1f} %" if marks else "-"


def line(what: str, ours: str, theirs: str = "-", target: str = "") -> None:
    """One figure of both."""
    print(f"  {what:44s} {ours:26s} {theirs:26s} {target}")


# -- report ------------------------------------------------------------------------


def outcome(rows: list[Row], condition: str) -> None:
    """Print what was named under a condition nearer to a machine, and five figures."""
    hidden = [r for r in rows if r["what"] != CLEAN]
    clean = [r for r in rows if r["what"] == CLEAN]
    print(f"\n{condition}: what was named, by truth")
    for what in (*truth.EFFECTS, *truth.ADDED, CLEAN):
        group = [r for r in rows if r["what"] == what]
        if group:
            print(f"  {what:20s} {_told(Counter(answer(r) for r in group))}")
    for row in hidden:
        if row["what"] == MACHINE:
            mark = "" if right(row) else "   <- wrong"
            print(f"  {row['seed']:3d}  {' + '.join(row['truth']):60s} "
                  f"{' + '.join(row['causes']) or row['verdict']}{mark}")  # fmt: skip
    print(f"\n{condition}{'':40s} {'diagnosis':26s} target")
    machine = condition == MACHINE
    for text, group, mark, target in (
        ("named right", hidden, right, "" if machine else ">= 95 %"),
        ("all causes found, named or as alternatives", hidden, all_found,
         ">= 85 %" if machine else ""),
        ("clean: no cause named", clean, lambda r: "error" not in r and not accused(r), ">= 95 %"),
        ('clean: "nothing to find"', clean, lambda r: r["verdict"] == "nothing to find",
         "" if machine else ">= 95 %"),
        ('verdict "explained"', hidden, lambda r: r["verdict"] == "explained", ">= 90 %"),
        ("records with a false cause", rows, lambda r: bool(false_causes(r)), "<= 5 %"),
    ):  # fmt: skip
        if group:
            print(f"  {text:44s} {share(group, mark):26s} {target}")
    seconds = [r["seconds"] for r in rows]
    told = f"{np.median(seconds):.1f} ({max(seconds):.1f})"
    print(f"  {'seconds a diagnosis, median (largest)':44s} {told:26s} < 20")
    _failures(rows)


def _failures(rows: list[Row]) -> None:
    """Print the last line of each error."""
    for row in rows:
        if "error" in row:
            print(f"  ERROR {row['what']} seed {row['seed']}: {row['error'].splitlines()[-1]}")


def report(rows: list[Row], condition: str) -> None:
    """Print everything about one blind condition."""
    single = [r for r in rows if r["what"] in (*truth.EFFECTS, *truth.ADDED)]
    clean = [r for r in rows if r["what"] == CLEAN]
    pairs = [r for r in rows if r["what"] == PAIR]
    outside = [r for r in rows if r["what"] == OUTSIDE]
    print(f"\n{condition}: what was named, by truth (best existing way in brackets)")
    for what in (*truth.EFFECTS, *truth.ADDED, CLEAN, OUTSIDE):
        group = [r for r in rows if r["what"] == what]
        if group:
            ours = _told(Counter(answer(r) for r in group))
            theirs = _told(Counter(r["peer"] or "nothing" for r in group))
            print(f"  {what:20s} {ours}   [{theirs}]")
    for row in pairs:
        mark = "" if right(row) else "   <- wrong"
        print(f"  pair {row['seed']:3d}  {' + '.join(row['truth']):38s} "
              f"{' + '.join(row['causes']) or row['verdict']}{mark}")  # fmt: skip
    print(f"\n{condition}{'':40s} {'diagnosis':26s} {'best existing way':26s} target")
    if single:
        line("named right", share(single, right), share(single, peer_right),
             {"exact": ">= 97 %", "short": "-"}.get(condition, ">= 95 %"))  # fmt: skip
        if condition == "off":
            line("  believing its parameters, gates of exact", "",
                 share(single, lambda r: peer_right(r, "peer_exact")))  # fmt: skip
        line("named right or in the alternatives", share(single, or_alternative), "-",
             ">= 90 %" if condition == "short" else "")  # fmt: skip
        count = [len(a) for r in single for c, a in zip(r["causes"], r["alternatives"], strict=True)
                 if c not in BASE]  # fmt: skip
        line("  alternatives of a cause, mean", f"{np.mean(count):.2f}" if count else "-")
        if condition != "off":
            line("  a right base parameter accused beside", share(
                [r for r in single if not set(r["truth"]) & set(BASE)],
                lambda r: bool(set(r["causes"]) & set(BASE))))  # fmt: skip
        target = ">= 90 %" if condition == "exact" else ""
        rates = _by_effect(single, right), _by_effect(single, peer_right)
        line("  worst effect", _worst(rates[0]), _worst(rates[1]), target)
    if clean:
        line("clean records accused", share(clean, accused), share(clean, _peer_accused), "<= 2 %")
        if condition == "off":
            line("  base parameters mended", share(clean, lambda r: bool(r["causes"])), "")
            line("  gates of exact", "", share(clean, lambda r: bool(foreign_of(r["peer_exact"]))))
    if outside:
        line("outside the catalogue, flagged", share(outside, lambda r: r["verdict"] in FLAGGED),
             "-", ">= 90 %")  # fmt: skip
        line("  and no cause named", share(outside, lambda r: not r["causes"]),
             share(outside, lambda r: r["peer"] is None))  # fmt: skip
    if pairs:
        line("both of a pair, nothing else", share(pairs, right), "-", ">= 80 %")
        line("  one of a pair, at least",
             share(pairs, lambda r: bool({*r["truth"]} & {*r["causes"]})),
             share(pairs, lambda r: r["peer"] in r["truth"]))  # fmt: skip
    _numbers(single, pairs)
    seconds = [r["seconds"] for r in rows]
    line("seconds a record, median (largest)", f"{np.median(seconds):.1f} ({max(seconds):.1f})",
         f"{np.median([r['peer_seconds'] for r in rows]):.2f}", "< 20")  # fmt: skip
    _failures(rows)


def foreign_of(name: str | None) -> list[str]:
    """The peer's answer unless it is a base parameter."""
    return foreign([name]) if name else []


def _peer_accused(row: Row) -> bool:
    return bool(foreign_of(row["peer"]) if row["condition"] == "off" else row["peer"])


def _told(count: Counter[str]) -> str:
    return ", ".join(f"{name} {k}" for name, k in count.most_common())


def _by_effect(rows: list[Row], mark: Callable[[Row], bool]) -> dict[str, float]:
    found: dict[str, list[bool]] = {}
    for row in rows:
        found.setdefault(row["what"], []).append(mark(row))
    return {what: float(np.mean(marks)) for what, marks in found.items()}


def _worst(rates: dict[str, float]) -> str:
    low = min(rates, key=lambda what: rates[what])
    return f"{low} {100.0 * rates[low]:.0f} %"


def _numbers(single: list[Row], pairs: list[Row]) -> None:
    """Parameters and held-out errors."""
    good = [r for r in single if right(r)]
    errors = [e for r in good for e in r["errors"].values()]
    if errors:
        line("parameter error, median (90 % quantile)",
             f"{100.0 * np.median(errors):.2g} % ({100.0 * np.quantile(errors, 0.9):.2g} %)", "-",
             "<= 15 %")  # fmt: skip
        each: dict[str, list[float]] = {}
        for row in good:
            for name, error in row["errors"].items():
                each.setdefault(name, []).append(error)
        medians = sorted(((float(np.median(e)), name) for name, e in each.items()), reverse=True)
        told = ", ".join(f"{name} {100.0 * error:.2g} %" for error, name in medians[:4])
        print(f"    largest medians: {told}")
    both = [e for r in pairs if right(r) for e in r["errors"].values()]
    if both:
        line("  in pairs", f"{100.0 * np.median(both):.2g} %")
    ratios = [r["after"] / r["floor"] for r in single if r["after"] is not None]
    if ratios:
        line("held-out error over its floor, median", f"{np.median(ratios):.3f}", "-", "<= 1.15")
        line("  share of records above 1.15", f"{100.0 * np.mean(np.array(ratios) > 1.15):.1f} %")


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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20, help="records per effect")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS),
                        choices=[*CONDITIONS, *GROUPS])  # fmt: skip
    parser.add_argument("--effects", nargs="+",
                        choices=[*truth.EFFECTS, *truth.ADDED, CLEAN, PAIR, OUTSIDE, MACHINE],
                        help="effects and kinds of records (default: all)")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=2, help="records at the same time")
    parser.add_argument("--store", type=Path, default=Path("diagnosis.jsonl"))
    parser.add_argument("--summary", action="store_true", help="only print what the store holds")
    parser.add_argument("--plot", type=Path, metavar="FILE",
                        help="confusion matrix of the effects, of all conditions run")  # fmt: skip
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
            (report if condition in truth.CONDITIONS else outcome)(some, condition)
    print("\nanswered wrongly:")
    wrong(rows)
    if options.plot:
        kinds = (*truth.EFFECTS, *truth.ADDED, CLEAN)
        some = [row for row in rows if row["what"] in kinds]
        under = ", ".join(dict.fromkeys(row["condition"] for row in some))
        pictures.confusion(
            [(row["what"], answer(row)) for row in some], kinds,
            f"{len(some)} simulated records, condition {under}", options.plot,
        )  # fmt: skip


if __name__ == "__main__":
    main()

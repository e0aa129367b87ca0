"""Damage sound files at random and watch what the readers do.

Run ``python benchmarks/fuzz_readers.py --minutes 30 [--only mdf tdms]``.  Sound CSV, MAT, gzip,
xlsx, parquet, mcap, npz, npy, jsonl, TOML (axis) and JSON (observer design, fit, record, BAM log)
files, and logs in MDF, TDMS, MAT 7.3, bags of ROS, CAN and ULog, are changed by hypothesis in one
to four places: bytes overwritten, inserted, removed, repeated, flipped, words replaced by what
breaks parsers, the rest cut off.  A reader may refuse with a ValueError or
return something sound; whatever else it does is a find, kept in ``--keep DIR``.  Prints counts,
and returns 1 if there were finds.
``tests/store/test_files.py`` runs the same for a moment with a fixed seed.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

for _folder in (Path(__file__).resolve().parents[1] / "tests", Path(__file__).resolve().parents[1]):
    if str(_folder) not in sys.path:
        sys.path.insert(0, str(_folder))

import damage  # noqa: E402

ROUND = 100  # examples of one kind before the next kind has its turn


def fuzz(
    minutes: float, first_seed: int, keep: Path, only: list[str]
) -> tuple[Counter[tuple[str, str]], list[str]]:
    """Counts by reader and outcome, and finds with the file that shows each."""
    counts: Counter[tuple[str, str]] = Counter()
    finds: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        files = damage.sound_files(folder)
        files = {name: files[name] for name in only or files}
        end = time.monotonic() + 60.0 * minutes
        turn = first_seed
        while time.monotonic() < end:
            for name, sound in files.items():
                if time.monotonic() > end:
                    break

                @seed(turn)
                @settings(
                    max_examples=ROUND, deadline=None, database=None, phases=[Phase.generate],
                    suppress_health_check=list(HealthCheck),
                )  # fmt: skip
                @given(damage.st.just(name), damage.st.sampled_from(sound), damage.damages)
                def one(kind, content, changes):  # type: ignore[no-untyped-def]
                    if time.monotonic() > end:
                        return
                    broken = damage.damaged(content, changes)
                    # on disk before it is read: a reader may take the interpreter with it
                    (keep / "last").write_bytes(broken)
                    said = damage.verdict(kind, broken, folder)
                    counts[kind, said if said in ("taken", "refused") else "find"] += 1
                    if said not in ("taken", "refused"):
                        kept = f"{kind}-{hashlib.sha1(broken).hexdigest()[:10]}"
                        if (
                            finds.setdefault(f"{kind}: {said[:60]}", kept) == kept
                            and not (keep / kept).exists()
                        ):
                            (keep / kept).write_bytes(broken)
                            print(f"FIND {kind}: {said} ({keep / kept})", flush=True)

                one()
            turn += 1
    return counts, [f"{said} ({name})" for said, name in finds.items()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=1.0, help="how long to go on")
    parser.add_argument("--seed", type=int, default=1, help="first seed; one a round")
    parser.add_argument("--keep", type=Path, default=Path("fuzz_finds"), help="folder for finds")
    parser.add_argument("--only", nargs="*", default=[], help="kinds of files, all if none")
    chosen = parser.parse_args()
    chosen.keep.mkdir(parents=True, exist_ok=True)
    counts, finds = fuzz(chosen.minutes, chosen.seed, chosen.keep, chosen.only)
    print(f"{'reader':8}{'taken':>10}{'refused':>10}{'finds':>8}")
    for kind in sorted({kind for kind, _ in counts}):
        row = [counts[kind, what] for what in ("taken", "refused", "find")]
        print(f"{kind:8}{row[0]:>10}{row[1]:>10}{row[2]:>8}")
    print(f"{sum(counts.values())} files in {chosen.minutes:g} minutes, {len(finds)} kinds of find")
    for find in finds:
        print(find)
    return 1 if finds else 0


if __name__ == "__main__":
    sys.exit(main())

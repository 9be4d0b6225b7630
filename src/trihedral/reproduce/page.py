"""The experiments from start to finish: testbeds, trials, tables and drawings in one folder."""

from collections.abc import Sequence
from pathlib import Path

from trihedral.output_folder import OutputFolder
from trihedral.pair.paper import PaperOptions
from trihedral.progress import Progress
from trihedral.reproduce.experiment import TestbedRun, run_experiments
from trihedral.reproduce.plots import figure_5, station_plan
from trihedral.reproduce.tables import (
    Row,
    angle_table,
    as_csv,
    as_markdown,
    summary_2,
    table_2,
    table_6,
    trial_rows,
)

_HEAD = """# The paper's experiments on simulated testbeds

Kim, Chen and Cho (2017). Testbeds are simulated with a rig like theirs, so sites, overlaps and distances are like
theirs, not the same. RMSE is the root mean square distance between where a pose and the true pose put the points of
the lower scan that lie on surface of the higher one; the paper does not define its own. "ICP", "planes" and "three
largest" begin at a true pose made as wrong as the paper's initial alignments were (up to 7, 2 and 12 degrees, 2.2 to
3 m over the scan); "pictures" begin where the scans' own pictures put them. "planes, three largest" takes the largest
three planes of each scan, whether or not they are the same walls; "planes" takes the largest three of those that one
motion lays on each other. "auto" is the default method, from geometry alone.
"""


def reproduce_tables(
    tables: Sequence[int],
    seeds: Sequence[int],
    out: Path,
    *,
    points: int = 600_000,
    threads: int | None = None,
    progress: Progress | None = None,
) -> str:
    """Run what the tables need, write everything into `out`, and give the text of reproduce.md.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    with OutputFolder(out) as folder:
        runs: list[TestbedRun] = []
        trials = run_experiments(
            tables,
            seeds,
            folder.path,
            options=PaperOptions(),
            points=points,
            threads=threads,
            progress=progress,
            each=runs.append,
        )
        parts = [_HEAD]

        def add(title: str, name: str, rows: Sequence[Row]) -> None:
            folder.write(f"{name}.csv", as_csv(rows).encode())
            parts.append(f"## {title}\n\n{as_markdown(rows)}")

        for table in tables:
            if table == 2:
                add("Table 2: RMSE of each pair, median over the seeds", "table2", table_2(trials))
                parts.append(as_markdown([{"figure": k, "value": v} for k, v in summary_2(trials).items()]))
                for against in ("overlap", "distance"):
                    folder.write(f"fig5-{against}.svg", figure_5(trials, against).encode())
                    parts.append(f"![RMSE against {against}](fig5-{against}.svg)\n")
            elif table == 6:
                add("Table 6: chained into one frame", "table6", table_6(trials, runs))
            else:
                add(f"Table {table}: deviation angles and RMSE", f"table{table}", angle_table(table, trials))
        folder.write("trials.csv", as_csv(trial_rows(trials)).encode())
        for run in runs:
            name = f"plan-{run.name}-{run.seed}.svg"
            folder.write(name, station_plan(run).encode())
            parts.append(f"![{run.name}, seed {run.seed}]({name})\n")
        text = "\n".join(parts)
        folder.write("reproduce.md", text.encode())
        return text

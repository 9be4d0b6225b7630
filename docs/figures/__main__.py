"""Draw the figures of the method's pages: `python docs/figures`. Scans are simulated with fixed seeds."""

from pathlib import Path

import job_stages
import matplotlib
import pair_stages

OUT = Path(__file__).parent / "made"
FIGURES = {
    "preparation": pair_stages.preparation,
    "hypotheses": pair_stages.hypotheses,
    "verification": pair_stages.verification,
    "refinement": pair_stages.refinement,
    "verdict": job_stages.verdict,
    "network": job_stages.network,
}

if __name__ == "__main__":
    matplotlib.use("Agg")
    matplotlib.rcParams.update(
        {
            "axes.spines.right": False,
            "axes.spines.top": False,
            "figure.constrained_layout.use": True,
            "font.size": 9,
            "savefig.dpi": 160,
        }
    )
    OUT.mkdir(exist_ok=True)
    for name, draw in FIGURES.items():
        # No date and no version in the file: the same figure gives the same bytes.
        draw().savefig(OUT / f"{name}.png", metadata={"Software": None})
        print(OUT / f"{name}.png")

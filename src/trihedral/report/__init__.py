"""The result for people and programs: registration.json, poses.csv, report.html.

In: `Registration`. Out: a plain document in the shape of the schema, from which everything else here is made.
"""

from trihedral.report.page import write_report
from trihedral.report.reading import read_result
from trihedral.report.result import Document, Input, to_document, write_poses, write_result
from trihedral.report.summary import summary
from trihedral.verdict.job import Verdict, judge

__all__ = [
    "Document",
    "Input",
    "Verdict",
    "judge",
    "read_result",
    "summary",
    "to_document",
    "write_poses",
    "write_report",
    "write_result",
]

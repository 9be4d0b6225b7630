"""What each figure of the report means; docs/report.md says the same at length."""

DEFINITIONS: tuple[tuple[str, str], ...] = (
    (
        "Fit, not accuracy",
        "Residuals say how well two scans lie on each other, not where they lie. Repeated storeys and "
        "bays fit perfectly and are wrong; that is why loops, free space and runners-up are given beside "
        "them.",
    ),
    (
        "RMS, median, P95, max",
        "Of the point-to-plane distances over the surface that both scans of a link saw, under the link's "
        "own pose, before all scans are adjusted together. Distances beyond the reach of the comparison "
        "are not counted as shared surface, so the largest can only be the reach.",
    ),
    (
        "Overlap",
        "Share of one scan's evenly sampled surface that lies on a surface of the other which faces alike, "
        "within the stated distance; both ways: of the first scan, then of the second.",
    ),
    (
        "Weakest direction",
        "The translation that the link knows least, with its standard deviation (1 sigma). A link can fit "
        "well and still slide along it, as in a corridor.",
    ),
    (
        "Runner-up",
        "Score of the best other pose over the score of this one. Near 1, another pose explains the data "
        "nearly as well, and the link is ambiguous.",
    ),
    (
        "Free-space conflict",
        "Of the surface that agrees or conflicts, the share that this pose puts where the other scanner "
        "saw through (a ray that reached a wall says that all before it is empty); the larger of both ways. "
        "People, cars and leaves move between scans and conflict; large planes should not.",
    ),
    (
        "Loop",
        "A closed walk of links. How far the product of their poses misses its start, in translation and "
        "rotation, beside what the links' covariances lead one to expect (1 sigma). The column of the same "
        "name among the links is the root mean square of missed over expected for the loops through that "
        "link: about 1 where the sigmas are honest, large for a link that spoils its loops.",
    ),
    (
        "Redundancy",
        "Of a link in the adjustment of all scans: how much of its six observations (three of rotation, three of "
        "translation) the other links check. 0: an error of it goes unseen; 6: it decides nothing.",
    ),
    (
        "Standardised residual",
        "How far a link or a control point lies off the adjusted result, over the sigma to expect of that; the "
        "largest of its components. Of honest links three quarters lie below 2 and one in 2,600 above 4.",
    ),
    (
        "Without it, moves by",
        "The most that any scan's position would change if the link were left out and all others adjusted anew.",
    ),
    (
        "Check point",
        "A control point that took no part in the adjustment. The sigma to expect of its residual holds those of "
        "the scan's pose, of its measurement in the scan and of its coordinates.",
    ),
    (
        "Sigma of a scan",
        "Standard deviation of its position and rotation from the adjustment of all links, in project "
        "axes. It contains what the fit knows, no error that all scans share.",
    ),
    (
        "Scan status",
        "Verified: at least two independent paths of links agree on the pose. Single-linked: one path. "
        "Ambiguous: two poses explain the data nearly as well. Not placed: no pose can be trusted.",
    ),
    (
        "Link verdict",
        "Accepted: used. Ambiguous: another pose explains the data nearly as well. Doubtful: too little "
        "to decide. Refused: contradicted by the data or by loops. Only accepted links place scans.",
    ),
    (
        "Score and appearance similarity of a preview",
        "Before a pair is registered in a job of many scans, it may be previewed. The score is the share of surface "
        "that holds the best pose found, less where surface contradicts it. Appearance similarity says how well "
        "what the surfaces show goes together under it: about 1 for the same, about 0 for nothing in common; a dash "
        "where that cannot be told.",
    ),
    (
        "Wall offset",
        "How far apart two scans put the same piece of wall in the section, where both see it from the "
        "same side: upright planes are fitted to half-metre pieces, and the median over about 1 m of wall "
        "is taken. Under the final poses.",
    ),
    (
        "Tolerance profile",
        "The limits of this job. Exit code 0: every scan is placed and the profile is met. 3: scans are "
        "missing, ambiguous or unreadable. 4: all are placed and the profile is not met.",
    ),
)

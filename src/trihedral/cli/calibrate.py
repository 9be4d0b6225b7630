"""`trihedral calibrate`: a camera from checkerboard pictures, or its pose from picked pairs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trihedral.cli.terminal import show, tell

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from trihedral.fusion.calibration import Board


def calibrate(
    pictures: Annotated[
        list[Path] | None,
        typer.Argument(metavar="PICTURES...", help="Pictures of a checkerboard, and folders of them."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Camera file to write.")] = Path("camera.toml"),
    pattern: Annotated[
        str, typer.Option(metavar="COLUMNSxROWS", help="Inner corners of the board, where four squares meet.")
    ] = "9x6",
    square_mm: Annotated[float, typer.Option(min=0.01, help="Side of a square.")] = 25.0,
    camera: Annotated[
        Path | None, typer.Option(help="Camera file whose pose is solved from --pairs.")
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option(help="CSV of picked pairs: x, y, z (metres), column, row (pixels); at least four."),
    ] = None,
) -> int:
    """Calibrate a camera: intrinsics from a checkerboard, or its pose from points picked in a scan.

    With PICTURES, finds the board in each, estimates focal lengths, principal point and distortion, and shows
    the reprojection error of every picture and of all. With --camera and --pairs, finds where the camera
    was, shows every residual, and writes the camera file with the pose in it.

    Exits with 2 when fewer than three boards are found, or the pairs leave the pose open.
    """
    from trihedral.atomic import check_absent

    check_absent(out)
    if pairs is not None:
        if camera is None or pictures:
            raise typer.BadParameter("it needs --camera, and no pictures", param_hint="--pairs")
        return _pose(camera, pairs, out)
    if camera is not None:
        raise typer.BadParameter("it needs --pairs", param_hint="--camera")
    if not pictures:
        raise typer.BadParameter("give pictures of a checkerboard, or --camera and --pairs")
    return _lens(pictures, out, pattern, square_mm)


def _lens(pictures: list[Path], out: Path, pattern: str, square_mm: float) -> int:
    import numpy as np

    from trihedral.fusion.calibration import Board, calibrate
    from trihedral.io.camera import write_camera

    try:
        columns, rows = (int(part) for part in pattern.lower().split("x"))
    except ValueError:
        raise typer.BadParameter(f"{pattern!r} is not like 9x6", param_hint="--pattern") from None
    board = Board(columns, rows, square_mm / 1000.0)
    found, (width, height) = _found_boards(pictures, board)
    corners = [places for _, places in found]
    result = calibrate(corners, board, (width, height))
    lens = result.camera
    assert lens.focal is not None and lens.centre is not None
    for (name, _), error in zip(found, result.each_px, strict=True):
        show(f"{name}: {error:.3f} px")
    show(f"all: {result.rms_px:.3f} px RMS reprojection error of {len(found)} pictures")
    sigmas = result.sigma_focal_px
    show(
        f"focal length {lens.focal[0]:.2f} +- {sigmas[0]:.2f}, {lens.focal[1]:.2f} +- {sigmas[1]:.2f} px; "
        f"principal point {lens.centre[0]:.2f}, {lens.centre[1]:.2f} px"
    )
    show("distortion " + ", ".join(f"{value:.5f}" for value in lens.distortion) + " (k1, k2, p1, p2, k3)")
    covered = _coverage(np.concatenate(corners), width, height)
    if covered < 0.5:
        tell(f"note: boards cover {covered:.0%} of the picture; the distortion elsewhere is extrapolated")
    write_camera(
        out,
        out.stem,
        lens,
        notes=[f"{len(found)} pictures of a checkerboard, RMS reprojection error {result.rms_px:.3f} px"],
    )
    show(out)
    return 0


def _found_boards(
    pictures: list[Path], board: "Board"
) -> tuple[list[tuple[str, "NDArray[np.float64]"]], tuple[int, int]]:
    """Names of the pictures that show the board, with its corners, and columns and rows of all pictures."""
    from trihedral.errors import InputError
    from trihedral.fusion.calibration import find_board
    from trihedral.io.pictures import picture_files, read_grey

    boards, first = [], None
    for path in picture_files(pictures):
        image = read_grey(path)
        if first is None:
            first = (path, image.shape)
        elif image.shape != first[1]:
            raise InputError(
                path,
                f"it has {image.shape[1]} x {image.shape[0]} pixels, {first[0].name} has "
                f"{first[1][1]} x {first[1][0]}",
                advice="Calibrate with pictures of one camera at one size",
            )
        corners = find_board(image, board)
        if corners is None:
            shape = f"{board.columns} x {board.rows}"
            tell(f"{path.name}: no whole board of {shape} inner corners found")
        else:
            boards.append((path.name, corners))
    assert first is not None
    return boards, (first[1][1], first[1][0])


def _coverage(corners: "NDArray[np.float64]", width: int, height: int) -> float:
    """Share of 8 x 6 parts of the picture in which corners were found."""
    import numpy as np

    parts = np.floor(corners / [width / 8, height / 6]).astype(int)
    return len(np.unique(parts, axis=0)) / 48.0


def _pose(camera: Path, pairs: Path, out: Path) -> int:
    from trihedral.fusion.calibration import solve_extrinsics
    from trihedral.io.camera import read_camera, read_pairs, write_camera

    described = read_camera(camera)
    points, pixels = read_pairs(pairs)
    found = solve_extrinsics(points, pixels, described.model)
    for number, residual in enumerate(found.residuals_px, 1):
        show(f"pair {number}: {residual:.2f} px")
    show(f"all: {found.rms_px:.2f} px RMS of {len(points)} pairs")
    position = found.frame_from_camera[:3, 3]
    sigma = 1000.0 * found.sigma_m
    show(
        f"camera at {position[0]:.4f}, {position[1]:.4f}, {position[2]:.4f} m, "
        f"+- {sigma[0]:.1f}, {sigma[1]:.1f}, {sigma[2]:.1f} mm"
    )
    if len(points) == 4:
        tell("note: four pairs can hardly show a wrong one; pick more")
    write_camera(
        out,
        described.name,
        described.model,
        found.frame_from_camera,
        notes=[f"pose from {len(points)} pairs, RMS {found.rms_px:.2f} px"],
    )
    show(out)
    return 0

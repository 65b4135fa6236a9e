"""jfsf register: a template mesh deformed onto a scan."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from jfsf.apps.cli import _options as opt
from jfsf.apps.cli._files import can_export, matchable
from jfsf.apps.cli._print import say_result, stage_bar
from jfsf.apps.cli._stored import of_kept, read_pair, stored_match
from jfsf.apps.report._words import verdict, warnings_of
from jfsf.types import Mesh

# Beyond these a registration is to be looked at.
MAX_MEAN = 0.005  # of sqrt(area), from the scan
MAX_BRIDGED = 0.05  # of the vertices


def register(
    template: Annotated[Path, typer.Argument(metavar="TEMPLATE", help=opt.FORMATS)],
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help=opt.FORMATS)],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            help="The file to write, the template on the scan: .ply, .obj or .glb. PLY "
            "and GLB also hold the distance of each vertex to the scan (quality) and "
            "whether it bridges a hole (bridged).",
        ),
    ],
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="MAP",
            help="The map from the template to the scan: a file of jfsf match TEMPLATE "
            "SCAN, or T_xy as .npz, .mat, .map or .vts. Computed when absent.",
        ),
    ] = None,
    base: opt.BaseOption = None,
    orientation: opt.OrientationOption = opt.Orientation.preserve,
    largest_component: Annotated[
        bool,
        typer.Option(
            "--largest-component",
            help="Use only the component with the largest area of each file.",
        ),
    ] = False,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair",
            help="Repair both meshes first, as jfsf info --help says. The file written "
            "then has the vertices and faces of the repaired template.",
        ),
    ] = False,
    no_cache: opt.NoCacheOption = False,
) -> None:
    """Deform a template mesh onto a scan: its faces, the scan's shape.

    Writes the template in the coordinates and units of the scan. Vertex i stays vertex
    i, so all scans that one template is registered to have one topology.

    Example: jfsf register template.ply scan.ply --out warped.ply
    """
    can_export([out], (template, scan))
    if map_file is not None and largest_component:
        raise ValueError(
            "--largest-component is for finding the map; a map of match "
            "--largest-component says itself which vertices it has; leave it out"
        )
    from jfsf.mesh import read_noted

    T = certificate = matched = None
    said: list[str] = []
    if map_file is not None:
        mesh, onto, maps, _ = read_pair(
            template, scan, map_file, None, None, base, mend=repair
        )
        T = maps.T_xy
        file = read_noted(template, finite=not repair).mesh
        if (stored := stored_match(map_file)) is not None:
            certificate, matched = stored.certificate, stored.matched_x
            if matched is not None:
                matched = of_kept(np.asarray(matched), file, mesh)
        if lost := len(file.vertices) - len(mesh.vertices):
            said.append(
                f"{template}: {lost} of {len(file.vertices)} vertices are left out, so "
                "those of the file written have other numbers"
            )
    else:
        paths = template, scan
        shapes = [matchable(path, largest_component, repair) for path in paths]
        mesh, onto = (shape.mesh for shape in shapes)
        for path, shape in zip(paths, shapes, strict=True):
            said += [f"{path}: {line}" for line in shape.said]
    with stage_bar() as stage:
        if T is None:
            from jfsf.matching import match

            options = {"orientation": orientation.value, "cache": not no_cache}
            found = match(mesh, onto, progress=stage, **options)
            T, certificate = np.asarray(found.T_xy), found.certificate
        warped = write_registered(out, mesh, onto, T, matched, stage)
    notes = registration_warnings(warped, onto)
    if certificate is not None:
        notes += warnings_of(certificate, orientation.value)
    shown = registration_table(warped, onto, certificate)
    say_result([shown], said, notes, [out])


def write_registered(out: Path, template: Mesh, scan: Mesh, T, matched, stage):
    """Deform a template onto a scan by a map, and write it; the registration.

    Args:
        out: the file.
        template, scan: as they were matched.
        T: the vertex of the scan for each vertex of the template.
        matched: the vertices of the template that count, of a match of parts; or None.
        stage: called with the name of each step as it begins.
    """
    from jfsf.apps.export import export_mesh
    from jfsf.apps.registration import register as register_mesh

    stage("registration")
    warped = register_mesh(template, scan, T, matched=matched)
    stage("writing")
    # A mirrored template would show its inside.
    faces = template.faces if warped.orientation_sign > 0 else template.faces[:, ::-1]
    values = {"quality": warped.distance, "bridged": warped.bridged}
    export_mesh(out, Mesh(warped.vertices, faces), values=values)
    return warped


def registration_table(warped, scan: Mesh, certificate) -> Table:
    """The figures of a registration, and the confidence of its map if it is known."""
    from jfsf.mesh import surface_area

    unit = np.sqrt(surface_area(scan))
    shown = Table(title="registration")
    for name in ("figure", "value", "% of sqrt(area)"):
        shown.add_column(name, justify="left" if name == "figure" else "right")
    distance = np.asarray(warped.distance)
    rows = {
        "mean": distance.mean(),
        "95 %": np.quantile(distance, 0.95),
        "largest": distance.max(),
    }
    for name, value in rows.items():
        words = f"distance to the scan, {name}"
        shown.add_row(words, f"{value:.4g}", f"{value / unit:.3%}")
    n = len(distance)
    shown.add_row("bridged vertices", f"{int(warped.bridged.sum())} of {n}")
    shown.add_row("flipped faces", str(int(warped.flipped)))
    shown.add_row("collapsed faces", str(int(warped.collapsed)))
    shown.add_row("scale of the template", f"{float(warped.scale):.4g}")
    if certificate is not None:
        likely = float(certificate.confidence)
        words = verdict(likely)
        if not np.isnan(likely):
            words = f"{likely:.2f}, {words}"
        shown.add_row("confidence of the map", words)
    return shown


def registration_warnings(warped, scan: Mesh) -> list[str]:
    """A line for each figure of a registration beyond what is usual."""
    from jfsf.mesh import surface_area

    notes = []
    mean = warped.distance.mean() / np.sqrt(surface_area(scan))
    if mean > MAX_MEAN:
        notes.append(
            f"the template is {mean:.2%} of sqrt(area) away from the scan in the mean: "
            "look at the map with match --report"
        )
    share = warped.bridged.mean()
    if share > MAX_BRIDGED:
        notes.append(f"{share:.0%} of the vertices have no scan near: is it a part?")
    if flaws := int(warped.flipped + warped.collapsed):
        are = "face is" if flaws == 1 else "faces are"
        notes.append(f"{flaws} {are} flipped or collapsed: look there")
    if warped.orientation_sign < 0:
        notes.append(
            "the map swaps left and right, so the template is mirrored; its faces are "
            "written the other way round"
        )
    return notes

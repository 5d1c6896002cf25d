"""`pgm export FORMAT WORK --out DIR`: work folders for other programs. A new format is a function and a row here."""

import tyro

from . import export_cameras, export_labels, export_motion, export_tables

FORMATS = {
    "colmap": export_cameras.colmap,
    "nerfstudio": export_cameras.nerfstudio,
    "coco": export_tables.coco,
    "mot": export_tables.mot,
    "track": export_tables.track,
    "captions": export_tables.captions,
    "smpl": export_motion.smpl,
    "bvh": export_motion.bvh,
    "cvat": export_labels.cvat,
    "label-studio": export_labels.label_studio,
}


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    return tyro.extras.subcommand_cli_from_dict(
        FORMATS,
        args=argv,
        prog="pgm export",
        description="Write a work folder's cameras, players, ball or words for another program; each format's --help"
        " says what is lost.",
    )

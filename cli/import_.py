"""`pgm import FORMAT FILE --out WORK`: work folders from other programs. A new format is a function and a row here."""

import tyro

from . import import_cameras, import_labels, import_motion

FORMATS = {
    "colmap": import_cameras.colmap,
    "nerfstudio": import_cameras.nerfstudio,
    "playable": import_cameras.playable,
    "smpl": import_motion.smpl,
    "bvh": import_motion.bvh,
    "cvat": import_labels.cvat,
    "label-studio": import_labels.label_studio,
}


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    return tyro.extras.subcommand_cli_from_dict(
        FORMATS,
        args=argv,
        prog="pgm import",
        description="Make a work folder of another program's cameras or skeletons, or take corrected labels into one;"
        " each format's --help says what is lost. Tracks, boxes, keypoints and captions of clips that are there already"
        " go to the stages: pgm-ball3d, pgm players, pgm caption.",
    )

"""`pgm export cvat` and `label-studio`: what the machine found, for a person to mend."""

from typing import TYPE_CHECKING, Annotated

import tyro

from .export_run import Export, Exported, run_export

if TYPE_CHECKING:
    from pgm_data.convert.corrected_labels import Form


def cvat(options: Annotated[Export, tyro.conf.arg(name="")]) -> int:
    """CLIP.xml for CVAT (CVAT for video 1.1): court points, players' boxes with captions, ball with events, graphics.

    `pgm import cvat` takes the mended file back. Lost: everything in metres, times, scores, alternatives of captions.
    """
    return _labels(options, "cvat")


def label_studio(options: Annotated[Export, tyro.conf.arg(name="")]) -> int:
    """CLIP.json for Label Studio: the same as predictions of a task, points as small boxes.

    `pgm import label-studio` takes the annotated export back. Lost: everything in metres, times, scores, alternatives.
    """
    return _labels(options, "label-studio")


def _labels(options: Export, form: "Form") -> int:
    def call() -> Exported:
        from pgm_data.convert.corrected_labels import export_labels

        outcome = export_labels(options.work, options.out, form=form)
        said = f"{outcome.rows} points and boxes of {len(outcome.files)} clips"
        return Exported(said=said, problems=outcome.problems)

    return run_export(options, call)

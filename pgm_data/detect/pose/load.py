"""The network of body points that a file holds, whatever its layout."""

from pathlib import Path

from pgm_data.detect.onnx_file import open_network
from pgm_data.detect.pose.blazepose import BlazePose
from pgm_data.detect.pose.heatmap import HeatmapPose, gives_heat
from pgm_data.detect.pose.model import PoseModel
from pgm_data.detect.pose.simcc import SimccPose, gives_bins
from pgm_data.weights import find_weights


def load_pose_model(path: Path | None = None, *, threads: int = 1) -> PoseModel | None:
    """The network in that file; without a path the BlazePose that `pgm weights pose` fetched, None where it did not.

    Args:
        path: A TFLite file of BlazePose, or an ONNX file with RTMPose's or ViTPose's answers.
        threads: That an ONNX file may use; BlazePose uses those that `cv2.setNumThreads` allows.

    Raises:
        FileNotFoundError: If there is no file at the path.
        ValueError: If the file is no network of a known layout.
        WeightsError: If the fetched file is not the pinned one.
    """
    if path is None:
        fetched = find_weights("pose")
        return None if fetched is None else BlazePose(fetched)
    if not path.is_file():
        raise FileNotFoundError(f"pose network: expected a file at {path}, found none")
    if path.suffix == ".tflite":
        return BlazePose(path)
    session = open_network(path, threads=threads, what="pose network")
    if gives_bins(session):
        return SimccPose(session, path)
    if gives_heat(session):
        return HeatmapPose(session, path)
    got = ", ".join(f"{entry.name}{entry.shape}" for entry in session.get_outputs())
    raise ValueError(
        f"pose network {path}: answers: expected two (n, points, bins) or one (n, points, rows, columns), got {got}"
    )

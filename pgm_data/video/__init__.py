"""Videos as frames with true times: read in order as they are displayed, and written.

Everything handed out is as DISPLAYED: the file's sample aspect ratio and rotation are applied. A frame's time is the
presentation time that the file gives; header counts and frame rates are only quoted, never used.
"""

from pgm_data.video.frames import CodecFrame, DecodedFrame, PictureFrame
from pgm_data.video.reader import VideoError, VideoInfo, VideoReader, open_video
from pgm_data.video.writer import write_video

__all__ = [
    "CodecFrame",
    "DecodedFrame",
    "PictureFrame",
    "VideoError",
    "VideoInfo",
    "VideoReader",
    "open_video",
    "write_video",
]

"""The scene's players in a clip: people found by every detector there is, put together, and followed."""

from collections.abc import Sequence

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import PersonFinder, Pictures
from pgm_data.detect.players.merged import merge_people, no_people
from pgm_data.detect.players.tracks import FollowOptions, follow_players
from pgm_data.people import PlayerBoxes
from pgm_data.scene import Scene


def find_players(
    finders: Sequence[PersonFinder],
    pictures: Pictures,
    clip: ClipCamera,
    *,
    size: tuple[int, int],
    scene: Scene,
    options: FollowOptions | None = None,
) -> PlayerBoxes:
    """Where the players of the scene are in the frames of a clip; nowhere without a finder.

    Args:
        finders: Detectors of people; what several find is put together.
        pictures: A fresh pass over the pictures of the clip at each call.
        clip: Its cameras.
        size: Width and height of the pictures, px.
        scene: What players there are.
        options: How they are followed.
    """
    people = no_people()
    if scene.players and clip.has_camera.any():
        for finder in finders:
            people = merge_people(people, finder.find(pictures, clip, size=size, scene=scene))
    return follow_players(people, clip, size=size, scene=scene, options=options)

"""Which frames of a video of a moving lamp become photographs, and which are dropped."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.capture.readers.base import Wanted
from rakelight.capture.recording import PHOTOGRAPHS, capture_of
from rakelight.capture.video.choice import most_different
from rakelight.capture.video.frames import look_through
from rakelight.capture.video.judging import reasons_to_drop
from rakelight.capture.video.light import FAR, NEAR, NEAR_FRAMES, explained, similar
from rakelight.capture.video.merging import MOST_AVERAGED, merged, same_light, still_depth
from rakelight.capture.video.positions import (
    LIGHT_PX,
    beyond_light,
    positions,
    solve_positions,
)
from rakelight.errors import CaptureError, InputError
from rakelight.model import Camera, silent
from tests.capture.moving_lamp import FPS, make_video, recording_of, single_shots

SIZE = 0.5


def dropped(video):
    frames = look_through(video.recording, silent)
    light = explained(frames)
    reasons = reasons_to_drop(frames, light, positions(frames, light.coefficients, silent))
    return {name: set(np.flatnonzero(these).tolist()) for name, these in reasons.items()}


def share_of(reasons, numbers):
    every = set().union(*reasons.values())
    return len(every & set(numbers)) / max(len(set(numbers)), 1)


@pytest.mark.parametrize("seed", [20, 21, 23])
def test_bad_frames_are_dropped_and_good_ones_are_not(seed):
    video = make_video(
        seed, 90, size=SIZE, arm=0.12, over=0.05, bump=65, shake=3, quality=90, flicker=0.03
    )
    reasons = dropped(video)
    assert share_of(reasons, video.bad) >= 0.95
    assert share_of(reasons, set(range(90)) - set(video.bad)) <= 0.1
    assert set(video.wrong["over"]) <= reasons["over-exposed"]


def test_a_frame_is_dropped_for_one_reason():
    reasons = dropped(make_video(20, 60, size=SIZE, arm=0.2, over=0.1, bump=45))
    numbers = [i for these in reasons.values() for i in these]
    assert len(numbers) == len(set(numbers))


def test_the_larger_still_part_is_kept():
    video = make_video(23, 80, size=SIZE, bump=25, bump_px=3.0)
    assert set(range(25)) <= dropped(video)["camera or object moved"]
    assert not dropped(make_video(23, 80, size=SIZE))["camera or object moved"]


@pytest.mark.parametrize(
    ("seed", "reason"),
    [
        (100, "camera or object moved"),
        (109, "camera or object moved"),
        (101, "something before the object"),
        (105, "blurred"),
    ],
)
def test_what_the_lamp_does_to_shading_is_no_fault(seed, reason):
    """Each lost 14 to 28 % of its frames for that."""
    assert len(dropped(make_video(seed, 80))[reason]) <= 0.1 * 80


def test_the_part_of_a_shift_that_light_may_cause_does_not_count():
    shift = np.array([0.3, 0.4])
    assert not beyond_light(shift, np.array([0.0, 0.5 / LIGHT_PX])).any()
    np.testing.assert_allclose(beyond_light(shift, np.array([0.1 / LIGHT_PX, 0.0])), 0.8 * shift)
    assert not beyond_light(np.zeros(2), np.zeros(2)).any()


def test_blur_is_seen_beside_frames_of_similar_light():
    video = make_video(21, 80, size=SIZE, blurred=0.08)
    reasons = dropped(video)
    assert share_of(reasons, video.wrong["blurred"]) >= 0.8
    assert share_of(reasons, set(range(80)) - set(video.bad)) <= 0.1


def test_positions_know_both_sides_of_a_bump_from_pairs_alike():
    edges = np.array([[0, 1], [2, 3], [0, 2], [1, 3], [1, 2]])
    shifts = np.array([[0, 0], [0, 0], [4, 1], [4, 1], [-9, 9.0]])
    at = solve_positions(4, edges, shifts, np.ones(5))
    assert np.abs(at[2] - at[0] - [4, 1]).max() < 0.05


def test_single_shots_are_all_kept():
    rng = np.random.default_rng(0)
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    lamp = np.stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), -0.8 + 0 * turn], axis=-1)
    order = rng.permutation(12)
    reading = capture_of(make_video(21, 12, size=SIZE, lamp=lamp[order]).recording, Wanted())
    assert reading.capture.names == tuple(f"frame {i}" for i in range(12))


@pytest.mark.parametrize("seed", range(20, 25))
def test_few_frames_lit_far_from_each_other_are_kept(seed):
    """Each lost 3 to 12 of its 24 frames."""
    lamp = single_shots(24, np.random.default_rng([seed, 5]))
    reasons = dropped(make_video(seed, 24, size=SIZE, lamp=lamp))
    assert share_of(reasons, range(24)) <= 0.05


def test_an_arm_before_one_of_few_frames_is_seen():
    lamp = single_shots(24, np.random.default_rng([2, 5]))
    video = make_video(21, 24, size=SIZE, lamp=lamp, arm=0.1)
    assert video.wrong["arm"]
    reasons = dropped(video)
    assert share_of(reasons, video.wrong["arm"]) >= 0.8


def test_frames_are_compared_to_twelve_however_few_are_far_in_time():
    lights = np.random.default_rng(0).standard_normal((20, 3))
    for frame in range(20):
        found = similar(lights, frame, NEAR, FAR, NEAR_FRAMES)
        assert len(set(found.tolist()) - {frame}) == NEAR + FAR


@pytest.mark.parametrize("timed", [True, False])
def test_frames_without_times_are_said_by_their_names(timed):
    video = make_video(21, 40, size=SIZE, over=0.1)
    color = replace(video.recording.color, timed=timed)
    names = tuple(f"color/{i:05}.png" for i in range(40))
    recording = replace(video.recording, color=color, names=names)
    reading = capture_of(recording, Wanted())
    said = {finding.code: finding.message for finding in reading.capture.findings}
    when = said["frames-over-exposed"]
    first = min(video.wrong["over"])
    assert (f"({first / FPS:.1f}" if timed else f"({names[first]}") in when
    assert ("png" in when) != timed
    slower = replace(recording, color=replace(color, times_s=10 * color.times_s))
    sheet = capture_of(slower, Wanted()).contact_sheet
    assert np.array_equal(sheet, reading.contact_sheet) != timed


def test_a_lamp_that_stands_still_is_an_error():
    video = make_video(21, 40, size=SIZE, still=True)
    untimed = replace(video.recording.color, timed=False)
    with pytest.raises(CaptureError, match=r"the light never changes .* in 1\.3 s"):
        capture_of(video.recording, Wanted())
    with pytest.raises(CaptureError, match=r"the light never changes .* in 40 frames"):
        capture_of(replace(video.recording, color=untimed), Wanted())


def test_too_few_usable_frames_say_why():
    video = make_video(21, 30, size=SIZE, over=1.0)
    with pytest.raises(CaptureError, match=r"too few frames.*over-exposed \d+.*expose shorter"):
        capture_of(video.recording, Wanted())


def test_a_capture_of_a_video_with_its_contact_sheet_and_findings():
    video = make_video(21, 80, size=SIZE, arm=0.15, quality=90)
    stages = []
    reading = capture_of(video.recording, Wanted(progress=lambda now: stages.append(now.stage)))
    capture = reading.capture
    assert capture.photographs.dtype == np.uint16
    assert (len(capture.photographs), capture.encoding) == (PHOTOGRAPHS, "linear")
    numbers = [int(name.split()[1]) for name in capture.names]
    assert not set(numbers) & set(video.bad)
    assert reading.contact_sheet.dtype == np.uint8
    assert 1000 < reading.contact_sheet.shape[1] <= 2000
    assert list(dict.fromkeys(stages)) == ["read", "choose", "average"]
    codes = {finding.code: finding for finding in capture.findings}
    assert "16 photographs of 80 frames" in codes["frames-taken"].message
    assert codes["frames-something-before-the-object"].remedy
    # the object, where no arm is: within noise of what the lamp shows
    seen = capture.photographs[3][video.truth.mask] / 65535
    true = video.clean[numbers[3]][video.truth.mask]
    assert np.median(np.abs(seen - true)) < 0.03


def test_wanted_photographs_are_those_among_the_chosen():
    video = make_video(21, 60, size=SIZE)
    every = capture_of(video.recording, Wanted()).capture
    some = capture_of(video.recording, Wanted(photographs=(5, 1))).capture
    assert some.names == (every.names[5], every.names[1])
    assert np.array_equal(some.photographs[1], every.photographs[1])
    with pytest.raises(InputError, match="numbers from 0 to 15"):
        capture_of(video.recording, Wanted(photographs=(16,)))


def test_frames_of_one_light_are_averaged_and_saturation_stays():
    rng = np.random.default_rng(1)
    turn = np.repeat(np.linspace(0, 2 * np.pi, 8, endpoint=False), 6)
    lamp = np.stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), -0.8 + 0 * turn], axis=-1)
    video = make_video(21, 48, size=SIZE, lamp=lamp, noise=0.02)
    video.frames[7, 50, 50] = 255
    recording = recording_of(video.frames, np.ones((8, 8), np.float32), video.recording.camera, rng)
    recording = replace(recording, depth=video.recording.depth)
    frames = look_through(recording, silent)
    light = explained(frames)
    groups = same_light(light, np.arange(48), [6, 20])
    assert sorted(groups[0]) == list(range(6, 12))
    assert sorted(groups[1]) == list(range(18, 24))
    assert MOST_AVERAGED >= 6
    images = merged(recording, frames, light, groups, silent)
    assert images[0, 50, 50].tolist() == [65535] * 3
    mask = video.truth.mask & (np.arange(mask_rows(video))[:, None] != 50)
    of_mean = np.std(images[0][mask] / 65535 - video.clean[6][mask])
    single = merged(recording, frames, light, [[6], [20]], silent)
    of_one = np.std(single[0][mask] / 65535 - video.clean[6][mask])
    assert of_mean < 0.5 * of_one  # of six: 0.41


def mask_rows(video):
    return video.truth.mask.shape[0]


def test_depth_is_of_frames_in_which_all_stands_still():
    video = make_video(21, 40, size=SIZE)
    frames = look_through(video.recording, silent)
    moved = np.arange(40) < 20
    maps = still_depth(video.recording, frames, moved, 1e9, 5)
    assert maps == [20, 25, 30, 34, 39]
    pixels = np.prod(video.recording.depth.shape)
    assert len(still_depth(video.recording, frames, moved, 2.5 * pixels, 5)) == 2


def test_the_choice_spreads_over_the_lights_seen():
    turn = np.radians([0, 1, 2, 3, 90, 91, 180, 270])
    lights = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    chosen = most_different(lights, 4)
    assert len({i // 90 for i in np.degrees(turn[chosen]).round().astype(int)}) == 4


def test_frames_that_end_early_are_an_error():
    video = make_video(21, 30, size=SIZE)
    color = video.recording.color
    short = replace(color, walk=lambda wanted: list(color.walk(wanted))[:-3])
    with pytest.raises(CaptureError, match="frames are missing"):
        capture_of(replace(video.recording, color=short), Wanted())


@pytest.mark.parametrize("turned", [False, True])
def test_an_object_as_thin_as_a_needle(turned, recwarn):
    """It fills no pixel of the small pictures by half."""
    camera = Camera(960, 720, 900.0, 900.0, 479.5, 359.5)
    v, u = np.mgrid[: camera.height, : camera.width]
    across, along = (u, v) if turned else (v, u)
    depth = np.where((np.abs(across - 301) < 3) & (np.abs(along - 350) < 250), 0.5, 1.5)
    texture = np.random.default_rng(0).integers(40, 120, (*camera.shape, 3))
    frames = np.stack([texture * (0.5 + 0.1 * (i % 5)) for i in range(6)]).astype(np.uint8)
    recording = recording_of(frames, depth.astype(np.float32), camera, None)
    frames = look_through(recording, silent)
    assert frames.mask.any()
    assert np.isfinite(frames.saturated).all()
    assert not recwarn.list

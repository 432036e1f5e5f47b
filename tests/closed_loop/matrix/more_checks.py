"""More rows of the fault matrix, as in `checks`: detectors, heights, looks, vibration."""

from dataclasses import replace

import numpy as np

from companion.types import Phase
from sitl_sim.worlds.ground import Ground
from tests.closed_loop.matrix.camera_checks import AMONG_TRUNKS, PIXELS
from tests.closed_loop.matrix.inprocess import InProcess, fly, run, scenario
from tests.closed_loop.matrix.measures import CRUISE, last_target, mode_after
from tests.closed_loop.matrix.world_checks import FAR

TWO_ABREAST = {
    "drones__starts": [[0.0, 0.0], [0.0, 3.0]],
    "drones__jitter": 0.0,
    "mission__targets_of": {"drone1": [[10.0, 0.0, 2.0]], "drone2": [[10.0, 3.0, 2.0]]},
}
HILLS = {"ground": "uneven", "slope_deg": 8.0}


def row_28_neighbour(note):
    """A neighbour is 3 m ahead, hovers or comes nearer; for 1 s the detector shows nothing.

    Its track outlasts three such looks and ends with the fourth; the drone is on its way round it
    by then.
    """
    for kind in ("hovers", "comes"):
        hovers = kind == "hovers"
        f = InProcess(
            scenario(
                [{"kind": "stop", "drone": "drone2", "at": 5.0}] if hovers else [],
                count=2,
                world={},
                drones__starts=[[0.0, 0.0], [7.0 if hovers else 14.0, 0.0]],
                drones__jitter=0.0,
                mission__targets_of={"drone2": [[7.0, 0.1, 2.0] if hovers else [-6.0, 0.0, 2.0]]},
            )
        )
        began = _nothing_seen(f, 3.0, 1.0)
        run(f)
        (since,) = began
        tracked = [len(o.tracks) for _, o in f.companions[0].ticks(since - 0.11, since + 1.31)]
        assert tracked[:4] == [1, 1, 1, 1], tracked
        assert set(tracked[4:11]) == {0}, tracked
        truth = f.truth.arrays()
        p = truth["position"][truth["t"] > 5.0].astype(float)
        least = float(np.linalg.norm(p[:, 0] - p[:, 1], axis=1).min())
        assert least > 0.6, (kind, least)
        assert f.figures()["targets_reached"]["drone1"] == "1/1", kind
        f.check_always()
        note(f"least distance to a neighbour that {kind} [m]", least)


def _nothing_seen(f, gap, seconds):
    """Take all detections from drone 1 for so long, from when drone 2 is nearer than `gap` [m].

    A gap without end begins at once.

    Return a list with the flight time [s] at which it began.
    """
    began = []

    def spoil(inputs):
        p, now = f.vehicles.p, f._now / 1e3
        if not began and (gap == np.inf or (now > 5.0 and np.linalg.norm(p[0] - p[1]) < gap)):
            began.append(now)
        if inputs.frame is None or not began or now >= began[0] + seconds:
            return inputs
        arrays = inputs.frame.arrays | {"neighbours": np.zeros((0, 6))}
        return replace(inputs, frame=replace(inputs.frame, arrays=arrays))

    f.companions[0].before = spoil
    return began


def row_28_trunk(note):
    """A trunk is 3 m ahead, and from then on the detector shows none: slow, then HOLD before it."""
    f = InProcess(scenario(mission__time_limit=16.0))
    began, trunk = [], f.world["cylinders"][0]

    def spoil(inputs):
        x, y, _ = f.vehicles.p[0]
        gap = np.hypot(x - trunk["x"], y - trunk["y"]) - trunk["radius"]
        if not began and f._now / 1e3 > 5.0 and gap < 3.0:
            began.append(f._now / 1e3)
        if inputs.frame is None or not began:
            return inputs
        arrays = inputs.frame.arrays | {
            "trunks": np.zeros((0, inputs.frame.arrays["trunks"].shape[1]))
        }
        return replace(inputs, frame=replace(inputs.frame, arrays=arrays))

    f.companions[0].before = spoil
    run(f)
    hold = mode_after(f, began[0], "HOLD")
    assert hold < 2.3
    f.check_always()
    note("no trunk is seen any more: HOLD", hold)


def row_28_unseen(note):
    """Two drones start 3 m apart, and the eyes of one show none: it does not set out, and holds."""
    f = InProcess(
        scenario(count=2, world={}, mission__time_limit=25.0, companion={}, **TWO_ABREAST)
    )
    _nothing_seen(f, np.inf, np.inf)
    flies, t = f.companions[0], f.truth
    run(f)
    since = next(at for at, o in flies.ticks(0.0) if o.phase is Phase.FLY)
    held = mode_after(f, since, "HOLD")
    assert 14.9 < held < 15.4, held
    arrays = t.arrays()
    level = arrays["position"][arrays["t"] >= since, 0, :2]
    moved = float(np.linalg.norm(level - level[0], axis=1).max())
    assert moved < 0.5, moved
    assert f.figures()["targets_reached"]["drone2"] == "1/1"
    f.check_always()
    note("none of the others is ever seen: moves by [m]", moved)


def row_34_drift_on_slopes(note):
    """The own height drifts upwards over hills: what the rangefinder tells is the ground."""
    for drift, seconds in ((1.0, 60.0), (6.0, 25.0)):
        f = fly(
            [{"kind": "height_drift", "amount": drift, "at": CRUISE, "for": seconds}],
            drones__rangefinder=True,
            **FAR | {"world": HILLS, "mission__time_limit": CRUISE + seconds},
        )
        note(f"least height over hills [m], {drift:g} m/min", _least_height(f, 0.7))


def row_34_pixels(note):
    """The own height drifts by 3 m/min and there is no rangefinder: the pictures tell the ground.

    In 40 s it drifts by as much as the drone flies high.
    """
    f = fly(
        [{"kind": "height_drift", "amount": 3.0, "at": CRUISE, "for": 40.0}],
        mission__time_limit=CRUISE + 40.0,
        **PIXELS | {"mission__targets": FAR["mission__targets"]},
    )
    f.check_always()
    assert f.moved(0, CRUISE) > 40.0
    note("least height over ground by pictures [m], 3 m/min", _least_height(f, 0.7))


def row_34_range(note):
    """The rangefinder is wrong by 1 m, or tells the same for ever over hills: no way down."""
    wrong = {
        "1 m too far": ({}, lambda told: told[-1] + 1.0),
        "1 m too near": ({}, lambda told: told[-1] - 1.0),
        "stuck": (HILLS, lambda told: told[0]),
    }
    for name, (world, spoilt) in wrong.items():
        options = FAR | {"world": world, "mission__time_limit": 40.0 if world else 25.0}
        f = InProcess(scenario(drones__rangefinder=True, **options))
        finder, told = f._autopilots._shared.rangefinder, []

        def measured(*given, f=f, measure=finder.measure, told=told, spoilt=spoilt):
            true = measure(*given)
            if f._now / 1e3 < CRUISE:
                return true
            told.append(true)
            return spoilt(told)

        finder.measure = measured
        run(f)
        assert f.moved(0, CRUISE) > 15.0
        note(f"least height over ground [m], rangefinder {name}", _least_height(f, 0.8))


def _least_height(f, least):
    """Return the least true height over ground [m] from CRUISE on, which is more than `least`."""
    truth = f.truth.arrays()
    p = truth["position"][truth["t"] > CRUISE, 0].astype(float)
    height = p[:, 2] - Ground(f.world).height(p[:, 0], p[:, 1])
    assert height.min() > least, height.min()
    return float(height.min())


def row_33_seen(note):
    """Other ground, bark and light: the packaged network sees all the same, and the drone flies."""
    eyes = {"sensing": {"obstacles": "network", "detector": "network"}}
    for look in ("birch", "snow"):
        world = AMONG_TRUNKS | {"look": look}
        f = fly(mission__time_limit=30.0, **PIXELS | {"world": world, "companion": eyes})
        f.check_always()
        assert f.figures()["targets_reached"]["drone1"] == "1/1", look
        note(f"least distance to a trunk [m], {look}", f.figures()["min_obstacle_distance_m"])


def row_37_vibration(note):
    """From the first picture on the camera shakes by 1 degree, and no gyro tells it."""
    for seed in (1, 2, 3):
        f = fly([{"kind": "camera_vibration"}], seed=seed, mission__time_limit=30.0, **PIXELS)
        f.check_always()
        assert f.figures()["targets_reached"]["drone1"] == "1/1", seed
        note(f"at its target [s], seed {seed}", last_target(f))

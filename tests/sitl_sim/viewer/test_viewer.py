"""The page draws truth and logs: checked on its objects, and in a browser."""

import socket
import time

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.figures.events import events
from sitl_sim.recording.run_folder import load_run
from sitl_sim.viewer import Live, Page, Replay
from tests.sitl_sim import flights

SIZE = {"width": 1000, "height": 700}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return load_run(flights.write_run(tmp_path_factory.mktemp("run")))


@pytest.fixture
def page(run):
    page = Page(Replay(run), port=free_port())
    page.start()
    yield page
    page.close()


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def truth_at(run, t):
    return run.truth["position"][np.searchsorted(run.truth["t"], t - 1e-9)]


def test_the_scene_agrees_with_truth_and_logs(run, page):
    for t in (0.0, 3.5, 8.0, 1.2):
        page.show(t)
        p = truth_at(run, t)
        np.testing.assert_allclose(page.scene.drones.batched_positions, p, atol=1e-5)
        np.testing.assert_allclose(page.scene.views.batched_positions, p, atol=1e-5)
    page.show(8.0)
    p = truth_at(run, 8.0)
    assert page.scene.plans.points.shape == (3 * 20, 2, 3)
    np.testing.assert_allclose(page.scene.plans.points[::20, 0], p, atol=0.11)
    edges = page.scene.threats.points
    np.testing.assert_allclose(edges[:, 0], p, atol=1e-5)
    np.testing.assert_allclose(edges[:, 1], p[[1, 0, 0]], atol=0.11)
    np.testing.assert_allclose(page.scene.tracks.points, p[1:], atol=0.11)  # of drone 1
    assert "**fly**" in page.state.content
    assert page.picture.image.std() > 10  # something is in the picture


def test_the_page_begins_when_the_drones_fly_and_leads_to_every_event(run, page):
    times = [e.time for e in events(run)]
    assert page.slider.value == pytest.approx(min(e.time for e in events(run) if e.text == "fly"))
    assert list(page._times.values()) == times
    marked = [mark.value for mark in page.slider._impl.props._marks]
    assert marked == sorted({round(t, 1) for t in times if 0 < t < page.slider.max})
    page._seek(9.0)
    np.testing.assert_allclose(page.scene.drones.batched_positions, truth_at(run, 9.0), atol=1e-5)


def test_a_page_can_begin_at_a_time(run):
    page = Page(Replay(run), port=free_port(), time=7.0)
    try:
        assert page.slider.value == 7.0
        at = page.scene.drones.batched_positions
        np.testing.assert_allclose(at, truth_at(run, 7.0), atol=1e-5)
    finally:
        page.close()


def test_a_layer_switched_off_stays_off(page):
    page.scene.layers["plans"] = False
    page.show(8.0)
    assert not page.scene.plans.visible
    assert page.scene.threats.visible


def test_a_live_page_shows_the_present_and_reads_growing_logs(run, tmp_path):
    live = Live(run.scenario, run.world, run.folder)
    page = Page(live, port=free_port())
    try:
        for k in range(0, 400, 2):
            live.update(run.truth["t"][k], run.truth["position"][k], run.truth["attitude"][k])
        page.show(0.0)
        np.testing.assert_allclose(
            page.scene.drones.batched_positions, run.truth["position"][398], atol=1e-5
        )
        assert live.belief(0, 0.0).record["phase"] == "fly"
        assert page.slider.disabled
    finally:
        page.close()


def test_twenty_drones_five_minutes_are_drawn_in_time(run):
    """Drawing a moment takes a small part of the 50 ms of 20 Hz."""
    n, times = 20, np.arange(0, 300.0, 0.02)
    rng = np.random.default_rng(1)
    p = np.cumsum(rng.normal(0, 0.01, (len(times), n, 3)), axis=0).astype(np.float32)
    q = np.tile(np.float32([1, 0, 0, 0]), (len(times), n, 1))
    many, few = Replay(run), Replay(run)
    many.names = [f"drone{i + 1}" for i in range(n)]
    many.belief = lambda drone, time: few.belief(drone % 3, time % 11.0)
    many._t, many._p, many._q = times, p, q
    page = Page(many, port=free_port())
    page._picture_time = np.inf  # pictures come by the clock on the wall, four a second at most
    try:
        taken = []
        for t in np.arange(10.0, 30.0, 1.0):
            started = time.thread_time()  # however busy the machine
            page.show(float(t))
            taken.append(time.thread_time() - started)
        assert np.median(taken) < 0.02
    finally:
        page.close()


@pytest.mark.parametrize("command", ["view", "report"])
def test_a_missing_folder_is_an_error(command, tmp_path, capsys):
    assert main([command, str(tmp_path / "nowhere")]) == 2
    assert "no such run folder" in capsys.readouterr().err


def test_in_a_browser_without_a_network(run, page, browser):
    tab = browser.new_page(viewport=SIZE)
    tab.set_default_timeout(120_000)  # a software renderer on a machine with other things to do
    asked, errors = [], []
    tab.on("request", lambda r: asked.append(r.url))
    tab.on("pageerror", lambda e: errors.append(str(e)))
    tab.goto(page.url)
    tab.wait_for_selector("canvas")
    until(lambda: len(page.server.get_clients()) == 1, tab)
    (client,) = page.server.get_clients().values()
    begun = truth_at(run, page.slider.value).mean(axis=0)
    until(lambda: np.allclose(client.camera.look_at, begun, atol=0.1), tab)  # at the drones

    seek(tab, 8.0)
    until(lambda: page.slider.value == 8.0 and drawn(page, run, 8.0), tab)
    assert drones_in_picture(page, run, 8.0, tab) == 3

    play = tab.get_by_label("play", exact=True)
    play.dispatch_event("click")
    until(lambda: page.slider.value > 9.0, tab)
    play.dispatch_event("click")
    until(lambda: not page.play.value, tab)
    until(lambda: drawn(page, run, page.slider.value), tab)
    # Not `now`: at the time where playing happened to stop, one drone may hide another.
    until(lambda: drones_in_picture(page, run, 10.0, tab) == 3, tab)  # a renderer takes its time
    assert drones_in_picture(page, run, 10.0, tab, shown=7.0) == 0  # it does tell
    assert not errors
    assert all(url.startswith((page.url, "data:", "blob:")) for url in asked)


def test_a_link_carries_its_time(run, page, browser):
    tab = browser.new_page(viewport=SIZE)
    tab.set_default_timeout(120_000)
    tab.goto(page.url + "/?t=7.5")
    # The slider moves first: another thread may still draw.
    until(lambda: page.slider.value == 7.5 and drawn(page, run, 7.5), tab)
    seek(tab, 9.0)
    until(lambda: tab.url == page.url + "/?t=9", tab)
    page._seek(3.2)  # as from an event, or another browser
    until(lambda: tab.url == page.url + "/?t=3.2", tab)
    assert page.slider.value == 3.2
    tab.close()


def drawn(page, run, t):
    """Return whether the page shows the drones where they truly were at t."""
    return np.allclose(page.scene.drones.batched_positions, truth_at(run, t), atol=1e-5)


def until(condition, tab, seconds=120.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        tab.wait_for_timeout(50)


def seek(tab, t):
    """Move the slider as a person does: type into its number field."""
    field = tab.locator("input[type=text], input[type=number]").first
    field.fill(str(t))
    field.press("Enter")


def drones_in_picture(page, run, t, tab, shown=None):
    """Number of drones that the browser draws at their places at t; it shows the time `shown`."""
    (client,) = page.server.get_clients().values()
    p = truth_at(run, t).astype(float)
    eye = p.mean(axis=0) + np.array([0.0, -0.5, 3.0])
    client.camera.up_direction, client.camera.position = (0.0, 0.0, 1.0), eye
    client.camera.look_at = p.mean(axis=0)
    page.scene.layers |= dict.fromkeys(page.scene.layers, False)
    page.show(t if shown is None else shown)
    tab.wait_for_timeout(1500)
    picture = as_array(tab.locator("canvas").first.screenshot())
    height, width = picture.shape[:2]
    forward = (p.mean(axis=0) - eye) / np.linalg.norm(p.mean(axis=0) - eye)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    up = np.cross(right, forward)
    focal = height / 2 / np.tan(client.camera.fov / 2)
    found = 0
    for place, colour in zip(p, page.scene.colours.astype(float), strict=True):
        d = place - eye
        u = round(width / 2 + focal * (d @ right) / (d @ forward))
        v = round(height / 2 - focal * (d @ up) / (d @ forward))
        patch = picture[v - 12 : v + 13, u - 12 : u + 13].reshape(-1, 3).astype(float)
        hue = patch - patch.mean(axis=1, keepdims=True)
        wanted = colour - colour.mean()
        likeness = (hue @ wanted) / (np.linalg.norm(hue, axis=1) * np.linalg.norm(wanted) + 1e-6)
        found += int((likeness > 0.9).sum() > 20)
    return found


def as_array(png):
    import cv2

    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]

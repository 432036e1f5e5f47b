"""The page in a real browser, with emulated vehicles and companions that fly by simulated time."""

import asyncio
import json
import os
import re
import shutil
import threading

import numpy as np
import pytest

from companion.ground.server import GroundServer
from companion.services.services import Situation
from companion.supervision.guard import Reason
from companion.types import Phase
from tests.companion.ground.emulated import Emulated
from tests.companion.ground.fleet_in_process import fleet

CHROMIUM = os.environ.get("CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
PATIENCE = 120_000  # ms: on a machine with other things to do
pytestmark = pytest.mark.timeout(900)


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine (apt install chromium, or set CHROMIUM)")
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as p:
        chromium = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


class Tab:
    """An engineer at the page."""

    def __init__(self, browser, url):
        self.asked, self.errors, self.states = [], [], []
        self.tab = browser.new_page(viewport={"width": 1400, "height": 900})
        self.tab.set_default_timeout(PATIENCE)
        self.tab.on("request", lambda r: self.asked.append(r.url))
        self.tab.on("pageerror", lambda e: self.errors.append(str(e)))
        self.tab.on("websocket", lambda ws: ws.on("framereceived", self._got))
        self.tab.goto(url)

    def _got(self, frame):
        told = json.loads(frame)
        if "state" in told:
            self.states.append(told["state"])

    def card(self, drone):
        return self.tab.locator(f".drone[data-drone={drone}]")

    def sees(self, drone, part, words):
        from playwright.sync_api import expect

        expect(self.card(drone).locator(f".{part}")).to_have_text(words)

    def choose(self, *drones):
        for box in self.tab.locator(".pick").all():
            box.uncheck()
        for drone in drones:
            self.card(drone).locator(".pick").check()

    def does(self, action, *drones, result="done", answer="Yes"):
        """Press a button for these drones, answer the question, and wait for each result."""
        from playwright.sync_api import expect

        self.choose(*drones)
        self.tab.locator(f"[data-do={action}]").click()
        expect(self.tab.get_by_role("dialog")).to_contain_text(drones[0])
        self.tab.get_by_role("dialog").get_by_role("button", name=answer).click()
        if answer == "Yes":
            for drone in drones:
                words = re.compile(f"^{action}: {result}")
                expect(self.card(drone).locator(".result")).to_have_text(words)


@pytest.fixture
def page(browser):
    tabs = []

    def open_at(url):
        tabs.append(Tab(browser, url))
        return tabs[-1]

    yield open_at
    for t in tabs:
        assert t.errors == []
        t.tab.close()


def test_every_button_of_a_flight(tmp_path, page):
    with fleet(2, tmp_path) as f:
        t = page(f.url)
        t.sees("drone1", "phase", "wait")
        t.does("arm", "drone1", "drone2", answer="Cancel")
        t.does("start", "drone2", result="its vehicle is disarmed: arm it")
        assert f.view(1).armed is False  # nobody was asked
        f.flight._autopilots.fail(1, "gyro")
        t.does("arm", "drone2", result="refused .*: disarmed, mode hold.*autopilot: Arming denied")
        f.flight._autopilots.fail(1, "gyro", failed=False)
        t.does("arm", "drone1", "drone2")
        t.does("takeoff", "drone1", "drone2")
        t.sees("drone1", "phase", "engage")
        t.sees("drone2", "phase", "engage")
        t.does("start", "drone1", "drone2")
        t.sees("drone1", "phase", "fly")
        t.does("hold", "drone1", "drone2")
        t.sees("drone1", "phase", "passive")
        t.does("start", "drone1", result="its companion is passive: resume it")
        t.does("goals", "drone1", result="refused: its companion takes no goals in phase passive")
        t.does("resume", "drone1")
        t.sees("drone1", "phase", "fly")
        new_goals(t, "drone1", "1, 2, 3\n4 5", problem="line 2: must be three numbers")
        new_goals(t, "drone1", "500, 0, 3", result="refused: goal 1, 500, 0, 3, is outside its")
        new_goals(t, "drone1", "1.5, 2, 3", result="done: 1 goals")
        assert f.view(1).goals == [[1.5, 2.0, 3.0]]
        t.does("return", "drone2")
        t.does("land", "drone1")
        assert all(url.startswith((f.url, f"ws://127.0.0.1:{f.port}/", "data:")) for url in t.asked)


def new_goals(t, drone, lines, problem="", result=""):
    from playwright.sync_api import expect

    t.choose(drone)
    t.tab.locator("[data-do=goals]").click()
    t.tab.locator("#goals").fill(lines)
    t.tab.locator("#yes").click()
    if problem:
        expect(t.tab.locator("#goals-problem")).to_contain_text(problem)
        t.tab.get_by_role("button", name="Cancel").click()
    else:
        words = re.compile(f"^goals: {result}")
        expect(t.card(drone).locator(".result")).to_have_text(words)


def test_a_lost_link_a_passive_companion_and_a_page_that_is_closed(tmp_path, page):
    from playwright.sync_api import expect

    with fleet(2, tmp_path) as f:
        t = page(f.url)
        for action in ("arm", "takeoff"):
            t.does(action, "drone1", "drone2")
        t.sees("drone1", "phase", "engage")
        t.sees("drone2", "phase", "engage")
        t.does("start", "drone1", "drone2")
        t.sees("drone2", "phase", "fly")
        f.line.cut.add(1)
        t.sees("drone1", "link", re.compile("^lost, "))
        expect(t.tab.locator("#summary")).to_contain_text("1 of 2 heard")
        t.does("land", "drone1", result="its vehicle is not heard")
        f.line.cut.clear()
        t.sees("drone1", "link", "heard")
        t.sees("drone1", "phase", "fly")
        t.tab.close()  # mid-flight: nothing changes
        seen, until = f.view(1), f.now + 5.0
        while f.now < until:
            f._thread.join(0.05)
            assert (seen.armed, seen.mode, seen.phase) == (True, "offboard", Phase.FLY)
        t = page(f.url)
        f.flight._autopilots.units[1].commander.set_mode(pilots_mode())
        t.sees("drone2", "phase", "passive")
        t.sees("drone1", "phase", "fly")
        expect(t.card("drone2")).to_have_class(re.compile("bad"))
        t.tab.locator("#logs").click()
        expect(t.tab.locator("#log")).to_contain_text("logs: 1 new")
        with t.tab.expect_popup() as opened:
            t.tab.locator("#debrief").click()
        expect(opened.value.locator("h1")).to_have_text("Debriefing")


def pilots_mode():
    from sitl_sim.vehicles.firmware.flavour import Mode

    return Mode.POSITION


def test_a_ground_station_that_ends_is_seen(tmp_path, page):
    from playwright.sync_api import expect

    with fleet(1, tmp_path) as f:
        t = page(f.url)
        t.sees("drone1", "phase", "wait")
    expect(t.tab.locator("#offline")).to_be_visible()
    expect(t.tab.locator("[data-do=hold]")).to_be_disabled()


@pytest.fixture
def ten():
    """Ten emulated vehicles, each with its companion's services, and the page; (world, url)."""
    world, stop, ready = Emulated(10), threading.Event(), threading.Event()
    server, port = GroundServer(world.station), []

    async def run():
        port.append(server.listen("127.0.0.1", 0))
        ready.set()
        while not stop.is_set():
            world.step()
            server.turn(world.now)
            await asyncio.sleep(0.02)  # no faster than a browser can draw
        for open_page in list(server.pages):
            open_page.close()
        await server.close()

    thread = threading.Thread(target=asyncio.run, args=(run(),))
    thread.start()
    assert ready.wait(60)
    yield world, f"http://127.0.0.1:{port[0]}/"
    stop.set()
    thread.join(60)


def test_ten_drones_of_which_one_refuses_one_is_lost_and_one_is_passive(ten, page):
    from playwright.sync_api import expect

    world, url = ten
    t = page(url)
    everyone = [f"drone{i}" for i in range(1, 11)]
    for drone in everyone:
        t.sees(drone, "link", "heard")
        t.sees(drone, "phase", "wait")
    world.vehicles.fail(1, "gyro")
    t.does("arm", "drone2", result="refused .*: disarmed, mode hold.*autopilot: Arming denied")
    t.does("arm", *(d for d in everyone if d != "drone2"))
    world.cut.add(4)
    world.situations[2] = Situation(Phase.FLY, Reason.PLAN)
    t.sees("drone3", "phase", "fly")
    world.situations[2] = Situation(Phase.PASSIVE)
    t.sees("drone3", "phase", "passive")
    expect(t.card("drone3")).to_have_class(re.compile("bad"))
    t.sees("drone5", "link", re.compile("^lost, "))
    expect(t.tab.locator("#summary")).to_contain_text("9 of 10 heard")
    t.does("land", "drone5", result="its vehicle is not heard")
    t.sees("drone6", "link", "heard")
    t.tab.locator("#all").check()
    expect(t.tab.locator(".pick:checked")).to_have_count(10)
    t.tab.locator("[data-do=hold]").click()
    for drone in everyone:
        expect(t.tab.get_by_role("dialog")).to_contain_text(drone)
    t.tab.get_by_role("dialog").get_by_role("button", name="Yes").click()
    for drone in everyone:
        heard = "done" if drone != "drone5" else "its vehicle is not heard"
        expect(t.card(drone).locator(".result")).to_have_text(re.compile(f"^hold: {heard}"))
    assert all(len(state["drones"]) == 10 for state in t.states)
    between = np.diff([state["time"] for state in t.states])
    assert len(between) > 20
    np.testing.assert_allclose(between, 0.1, atol=0.021)  # of the world's time: 10 Hz

"""The dashboard in a real Chromium, beside a real companion that dives a simulated vehicle."""

import http.client
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright
from tools.processes import HOLDFAST, free_port, running
from waiting import PATIENT, until

from companion.records import State
from companion.telemetry import schemas as telemetry
from dashboard.zenoh_client import Subscription

STALE_WITHIN_S = 1.0
ENGAGE_S = 8.0
PAGE_BYTES = 300_000
HOLDS = (
    "document.querySelector('#banner').dataset.state === 'ACTIVE' && document.body.dataset.stale === 'no'"
    " && holdfast.count.frames > 2"
)
TOKEN = "a-token-of-the-test"
_JUMP = "{t_s: %s, kind: 'condition', severity: 'warning', text: '%sclock jumped'}"


def _proved(saturated: list[int], lambda_in_force: list[float]) -> str:
    """Return JavaScript for where the line "proved" is drawn; points are 0.4 s apart."""
    count = len(saturated)
    law = [[], [0.0] * count, saturated, lambda_in_force, [1] * count]
    axis = {"mass": 2, "kappa_per_s": 2, "lambda_per_s": 2, "max_disturbance": 1}
    words = ", ".join(map(json.dumps, ([0.4 * i for i in range(count)], law, axis)))
    return f"m.proved({words}).map(Number.isFinite).map(Number).join('')"


_ON_TOP = (
    "((box) => document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2)?.id)"
    "(document.getElementById('%s').getBoundingClientRect()) === 'release'"
)
_CLIPPED = """[...document.querySelectorAll(".readouts, #commands, .words, .facts, .state, .fields")]
  .filter((one) => one.checkVisibility())
  .filter((one) => one.scrollWidth > one.clientWidth + 1 || one.scrollHeight > one.clientHeight + 1)
  .map((one) => `${one.className} of ${one.closest("[id]").id}`)"""


PURE: list[tuple[str, str, Any]] = [
    (
        "words",
        f"m.collapsed([{_JUMP % (1, '')}, {_JUMP % (2, 'over: ')}, {_JUMP % (30, '')},"
        f" {_JUMP % (30.5, 'over: ')}, {_JUMP % (200, '')}], {{}}, {{}}).map(m.rowText)",
        ["Clock jumped", "Clock jumped · 2 times, the last for 0.5 s"],
    ),
    (
        "words",
        "m.collapsed([{t_s: 1, kind: 'condition', text: 'silent'},"
        " {t_s: 3, kind: 'condition', text: 'heard'},"
        " {t_s: 3, kind: 'state', text: 'ACTIVE: engaged'}], {ACTIVE: 'holding'}, {heard: 'silent'})"
        ".map(m.rowText)",
        ["Holding: engaged", "Silent · for 2.0 s"],  # the newest first
    ),
    ("plots", "m.shaded([1, NaN, 1, 0], [0, 0.001, 9, 9.1], 0)", [0, 0, 0]),  # not through a gap
    (
        "panels",
        _proved([0, 1, *[0] * 10], [2.0] * 12),
        "000000000111",
    ),  # saturated at 0.4 s: 3/kappa + 3/lambda
    ("panels", _proved([0] * 12, [2.0, 2.0, 1.9, *[2.0] * 9]), "000000000011"),  # gains reduced at 0.8 s
    (
        "events",
        "((model) => { const found = {model_gain: 0.9, model_gain_found: 0.8, model_gain_doubt: 0.1};"
        " model.read({status: {dead_motor: 5, model: {z: found}}});"
        " return ['tbody', 'p'].map((name) => model.node.querySelector(name).textContent).join('|');"
        " })(new m.Model(null))",
        "heave× 0.900.80 ± 10 %––yaw––––surge––––sway––––|Motor 5 gives no thrust.",
    ),
    (
        "map",
        "m.trail({t: [0, 0.1, 0.2, 9], number: 0, of: {n: [1, 2, NaN, 4], e: [5, 6, 7, 8]}},"
        " ['n', 'e'], 0, 4)",
        [None, [1, 5], [2, 6], None, [4, 8]],  # a gap breaks it
    ),
]
"""What plain functions of the page give: module, expression, value."""
CHROMIUM = shutil.which("chromium") or ""
ARGUMENTS = ["--no-sandbox", "--headless", "--disable-gpu", "--disable-background-networking"]

if not CHROMIUM and not os.environ.get("CI"):
    pytest.skip("chromium is not installed: .ci/apt brings it", allow_module_level=True)


class Dive:
    """A vehicle, its companion and two dashboards: one that may command, one that is read-only."""

    def __init__(self, processes: ExitStack, token: Path) -> None:
        self._processes, self.token = processes, token
        token.write_text(TOKEN)
        self.zenoh, self._link = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
        self.port, self.looking_port = free_port(), free_port()
        self.start_companion()
        self.start_dashboard()
        self._start("dashboard", "--connect", self.zenoh, "--listen", f"127.0.0.1:{self.looking_port}")
        link = ("--udp-connect", self._link, "--zenoh", self.zenoh, "--name", "kelp")
        self.vehicle = self._start("sim", *link, "--set", "waves.enabled=true")

    def start_companion(self) -> None:
        settings = (
            *(f"link.endpoint=udp-listen:{self._link}", f"telemetry.endpoint={self.zenoh}"),
            *("vehicle.name=kelp", *PATIENT),
        )
        options = ("--engage", "--arm", "--depth", "1", "--heading", "20", "--allow-control")
        self.companion = self._start("run", *options, *(f"--set={setting}" for setting in settings))

    def start_dashboard(self) -> None:
        control = ("--allow-control", "--token-file", str(self.token))
        self.server = self._start(
            "dashboard", "--connect", self.zenoh, "--listen", f"127.0.0.1:{self.port}", *control
        )

    def _start(self, *arguments: str) -> subprocess.Popen[str]:
        return self._processes.enter_context(running(*HOLDFAST, *arguments))


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dive]:
    assert CHROMIUM, "chromium is missing, and CI wants these tests: .ci/apt brings it"
    with ExitStack() as processes:
        dive = Dive(processes, tmp_path_factory.mktemp("dive") / "token")
        for port in (dive.port, dive.looking_port):
            until(lambda port=port: _answers(port))  # type: ignore[misc]
        yield dive


@pytest.fixture(scope="module")
def browser(dive: Dive) -> Iterator[Browser]:
    with sync_playwright() as play:
        yield play.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)


@pytest.fixture(scope="module")
def pages(browser: Browser, dive: Dive) -> Iterator[Page]:
    """One page for what needs no vehicle."""
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{dive.port}")
    yield page
    page.close()


@pytest.fixture
def opened(browser: Browser, dive: Dive) -> Iterator[Callable[..., Page]]:
    """Open a page of the dashboard; at the end nothing may have been said on its console."""
    said: list[str] = []
    pages: list[Page] = []

    def go(path: str = "/engineer", port: int = 0, live: bool = True, width: int = 1440) -> Page:
        page = browser.new_page(viewport={"width": width, "height": 844})
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on(
            "console",
            lambda m: said.append(m.text) if m.type != "log" and not _network(m.text) else None,
        )
        page.goto(f"http://127.0.0.1:{port or dive.port}{path}")
        pages.append(page)
        if live:
            _active(dive, page)
        return page

    yield go
    for page in pages:
        page.close()
    assert said == []


def test_a_live_dive(opened: Callable[..., Page]) -> None:
    page = opened()
    titles = page.locator(".panel h2").all_text_contents()
    assert len(titles) == 15
    assert page.locator("#panel-map").is_hidden()  # without a position
    assert page.locator("#fact-mode").text_content() == "MANUAL"
    assert page.locator("#fact-armed").text_content() == "ARMED"
    assert page.locator("#reason").text_content() == "engaged"
    frames, last = _get(page, "[holdfast.count.frames, holdfast.store.last]")
    _wait(page, f"holdfast.count.frames > {frames + 20} && holdfast.store.last > {last + 1.0}")
    assert abs(_get(page, "holdfast.store.value('depth_m')") - 1.0) < 1.5
    assert _get(page, "holdfast.store.value('z.engaged')") == 1.0
    _wait(page, "Number.isFinite(holdfast.store.value('true.z.d'))")  # the simulator's
    _wait(page, "document.querySelector('#panel-depth .measured b').textContent.match(/^-?\\d\\.\\d{3}$/)")
    seen = "filter((c) => c.checkVisibility() && c.getBoundingClientRect().bottom < innerHeight)"
    painted = f"[...document.querySelectorAll('.plot canvas')].{seen}.map((c) => c.toDataURL().length)"
    assert len(_get(page, painted)) >= 6
    assert all(size > 2000 for size in _get(page, painted))
    weight = "performance.getEntriesByType('resource').concat(performance.getEntriesByType('navigation'))"
    assert _get(page, f"{weight}.reduce((sum, e) => sum + e.encodedBodySize, 0)") < PAGE_BYTES
    hosts = _get(page, f"[...new Set({weight}.map((e) => new URL(e.name).hostname))]")
    assert hosts == ["127.0.0.1"]  # no internet
    _wait(page, "/^\\d\\.\\d\\d m$/.test(document.querySelector('#depth-is').textContent)")
    assert re.fullmatch(r"-?\d\.\d\d m", page.locator("#depth-wanted").text_content() or "")
    assert page.locator("#meaning").text_content() == "Holdfast holds here"
    assert re.fullmatch(r"× [01]\.\d\d", page.locator("#panel-model td").first.text_content() or "")
    with page.expect_download() as saved:
        page.locator("#save-csv").click()
    lines = saved.value.path().read_text().splitlines()
    assert lines[0].startswith("t_s,utc,x_m,y_m,depth_m")
    assert 50 < len(lines) <= 1600
    assert len({line.count(",") for line in lines}) == 1
    with page.expect_download() as saved:
        page.locator("#save-png").click()
    assert saved.value.path().read_bytes().startswith(b"\x89PNG")
    assert re.fullmatch(r"kelp-\d{8}T\d{6}Z\.png", saved.value.suggested_filename)


@pytest.mark.parametrize(("module", "expression", "wanted"), PURE)
def test_the_pages_pure_parts(pages: Page, module: str, expression: str, wanted: Any) -> None:
    assert pages.evaluate(f"import('/static/{module}.js').then((m) => {expression})") == wanted


def test_pause_zoom_cursor_and_keys(opened: Callable[..., Page]) -> None:
    page = opened()
    page.keyboard.press("Space")
    assert _get(page, "holdfast.view.paused")
    box = page.locator("#panel-error .u-over").bounding_box()
    assert box
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
    at = page.locator("#cursor")
    _wait(page, "document.querySelector('#cursor').textContent.includes('-15.0')")
    lines = "[...document.querySelectorAll('.plots .u-cursor-x')].map((e) => e.getBoundingClientRect().x)"
    assert max(map(abs, _get(page, lines))) > 0
    assert at.text_content()
    page.mouse.down()
    page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + 40, steps=4)
    page.mouse.up()
    begin, end = _get(page, "holdfast.view.zoom")
    assert 5.0 < end - begin < 10.0
    page.keyboard.press("Escape")
    assert not _get(page, "holdfast.view.paused || holdfast.view.zoom")
    page.keyboard.press("2")
    _wait(page, "document.querySelector('#panel-error h2').textContent === 'Heading error'")
    page.keyboard.press("-")
    assert _get(page, "holdfast.view.span") == 60
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("Escape")
    before = _get(page, "getComputedStyle(document.body).backgroundColor")
    page.keyboard.press("t")
    assert _get(page, "getComputedStyle(document.body).backgroundColor") != before


def test_a_panel_stands_alone(opened: Callable[..., Page]) -> None:
    for panel in ("heading", "status"):
        page = opened(f"/panel/{panel}")
        assert page.locator("#banner").is_visible()
        assert page.locator(".panel").count() == (panel != "status")


def test_a_bad_token_is_refused(dive: Dive, opened: Callable[..., Page]) -> None:
    page = opened("/engineer#token=another")
    page.keyboard.press("g")
    _wait(page, "document.querySelector('#said').dataset.level === 'bad'")
    assert page.locator("#engage").is_disabled()
    assert page.locator("#release").is_disabled()
    for port, token, status in (
        (dive.port, "another", 401),
        (dive.port, "", 401),
        (dive.looking_port, TOKEN, 403),
        (dive.looking_port, "", 403),
    ):
        assert _post(port, "/api/kelp/release", token)[0] == status
    assert _get(page, "document.querySelector('#banner').dataset.state") == "ACTIVE"
    assert _post(dive.port, "/api/token", TOKEN)[0] == 200
    assert _post(dive.port, "/api/kelp/arm", TOKEN)[0] == 400
    assert _post(dive.port, "/api/dulse/release", TOKEN)[0] == 404
    assert _post(dive.port, "/api/kelp/release", TOKEN, origin="http://evil.example")[0] == 403
    assert _post(dive.port, "/api/kelp/release", TOKEN, origin=None)[0] == 403
    looking = opened(port=dive.looking_port)
    looking.keyboard.press("g")
    assert looking.locator("#commands .read-only").is_visible()
    assert looking.locator("#release").is_hidden()
    assert looking.locator("#apply").is_disabled()


def test_strangers_are_kept_out(dive: Dive) -> None:
    """Which host and origin is ours is in test_dashboard_gate: here that every way in asks."""
    ours = f"127.0.0.1:{dive.port}"
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    upgrade["Sec-WebSocket-Key"] = "dGhlIHNhbXBsZSBub25jZQ=="
    for path, headers, status in (
        ("/", {"Host": "rebound.example"}, 421),
        ("/../app.py", {}, 404),
        ("/static/../app.py", {}, 404),
        ("/panel/nothing", {}, 404),
        ("/ws", upgrade, 403),
        ("/ws", upgrade | {"Origin": "http://evil.example"}, 403),
        ("/ws", upgrade | {"Origin": f"http://{ours}"}, 101),
    ):
        assert _request(dive.port, "GET", path, headers)[0] == status, (path, headers)
    extras = json.loads(_request(dive.port, "GET", "/cockpit_extras.json", {})[1])
    for widget in extras["widgets"]:
        for address in (widget["iframe_url"], widget["iframe_icon"]):
            assert address.startswith(f"http://{ours}/")
            assert _request(dive.port, "GET", address.removeprefix(f"http://{ours}"), {})[0] == 200
    assert json.loads(_request(dive.port, "GET", "/register_service", {})[1])["extras"]


def test_tuning_there_and_back(dive: Dive, opened: Callable[..., Page]) -> None:
    page = opened(f"/engineer#token={TOKEN}")
    assert TOKEN not in page.url
    page.keyboard.press("g")
    _wait(page, "!document.querySelector('#apply').matches(':disabled')")
    gain = page.locator("#set-kappa_per_s")
    now = page.locator("label:has(#set-kappa_per_s) .now")
    before = float(now.text_content() or "nan")
    gain.fill(str(before - 2.0))
    page.locator("#apply").click()
    _wait(
        page,
        "((node) => node.dataset.level === 'good' && !node.textContent.endsWith('…') && node.textContent)"
        "(document.querySelector('#said'))",
    )
    assert float(now.text_content() or "nan") == before - 2.0
    assert _config(dive)["heave"]["kappa_per_s"] == before - 2.0
    gain.fill(str(before * 100.0))
    page.locator("#apply").click()
    _wait(page, "document.querySelector('#said').dataset.level === 'bad'")
    assert float(now.text_content() or "nan") == before - 2.0
    assert "must be 0.05 to 50" in (page.locator("#said").text_content() or "")
    gain.fill(str(before / 4.0))
    page.locator("#apply").click()  # asks
    assert "more than a factor of two" in (page.locator("#said").text_content() or "")
    assert _config(dive)["heave"]["kappa_per_s"] == before - 2.0
    page.locator("#apply").click()
    until(lambda: _config(dive)["heave"]["kappa_per_s"] == before / 4.0)
    _wait(page, f"document.querySelector('label:has(#set-kappa_per_s) .now').textContent == {before / 4.0:g}")
    page.locator("#revert").click()
    until(lambda: _config(dive)["heave"]["kappa_per_s"] == before - 2.0)
    forget = page.locator("#reset-model")
    forget.click()  # asks
    forget.click()
    _wait(page, "document.querySelector('#said').textContent.startsWith('reset_model: ')")
    assert page.locator("#said").get_attribute("data-level") == "good"


def test_the_pilot_moves_releases_and_engages(dive: Dive, opened: Callable[..., Page]) -> None:
    page = opened(f"/#token={TOKEN}")
    assert TOKEN not in page.url
    _wait(page, "!document.querySelector('#release').disabled")
    assert page.locator("#engage").is_disabled()  # it holds already
    assert page.locator("#wait").is_disabled()  # there is no path
    page.locator("#go").click()
    assert page.locator("#goto-x_m").is_disabled()  # there is no position
    page.locator("#goto").get_by_text("a place").click()
    page.locator("#goto-go").click()
    _wait(page, "document.querySelector('.needs').textContent.startsWith('Fill in')")
    page.locator("#goto-depth_m").fill("1.2")
    page.locator("#goto-go").click()
    _wait(page, "holdfast.store.value('depth_desired_m') > 1.15")
    _wait(page, "!document.querySelector('#goto').open")
    page.locator("#go").click()
    page.locator("#goto").get_by_text("from here").click()
    page.locator("#goto-depth_m").fill("-0.2")
    page.locator("#goto-go").click()
    _wait(page, "holdfast.store.value('depth_desired_m') < 1.1")
    page.locator("#hold").click()
    _wait(page, "document.querySelector('#said').textContent.startsWith('path: ')")
    page.locator("#ask").click()  # the help is open, and Release works
    page.locator("#release").click()
    _wait(page, "document.querySelector('#banner').dataset.state !== 'ACTIVE'")
    page.keyboard.press("Escape")
    _wait(page, "document.querySelector('#engage').matches(':enabled')")
    page.locator("#engage").click()  # asks
    page.locator("#engage").click()
    _active(dive, page)
    page.locator("#theme").focus()
    page.keyboard.press("r")
    _wait(page, "document.querySelector('#banner').dataset.state !== 'ACTIVE'")
    _active(dive, page, ask_in_s=0.0)


def test_depth_and_heading_by_one_tap(dive: Dive, opened: Callable[..., Page]) -> None:
    page = opened(f"/#token={TOKEN}")
    _wait(page, "!document.querySelector('#depth-to').disabled")
    page.locator("#depth-to").fill("1.5")
    page.keyboard.press("Enter")
    _wait(page, "document.querySelector('#said').textContent.startsWith('goto: on its way to depth 1.5 m')")
    page.locator("[data-step=depth_m][value='0.1']").click()  # from where it goes, not from where it is
    page.keyboard.press("ArrowDown")
    _wait(page, "Math.abs(holdfast.store.value('depth_desired_m') - 1.7) < 0.005")
    page.keyboard.press("ArrowUp")
    _wait(page, "Math.abs(holdfast.store.value('depth_desired_m') - 1.6) < 0.005")
    heading = _get(page, "holdfast.store.value('heading_desired_rad')")
    page.locator("[data-step=heading_deg][value='-5']").click()
    _wait(page, f"Math.abs(holdfast.store.value('heading_desired_rad') - ({heading} - 0.0873)) < 0.005")
    page.locator("#depth-to").fill("900")
    page.keyboard.press("Enter")
    _wait(page, "document.querySelector('#said').dataset.level === 'bad'")  # max_depth_m
    assert "max_depth_m" in (page.locator("#said").text_content() or "")
    page.locator("#depth-to").fill("1")
    page.keyboard.press("Enter")
    _wait(page, "Math.abs(holdfast.store.value('depth_desired_m') - 1) < 0.005")


_HEARD = """(() => {
  window.heard = [];
  const start = OscillatorNode.prototype.start;
  OscillatorNode.prototype.start = function (at) {
    window.heard.push(this.context.state);
    start.call(this, at);
  };
  navigator.vibrate = (pattern) => { if (pattern) window.heard.push("vibration"); return true; };
})()"""


def test_an_alarm_is_heard_and_felt_when_control_ends_without_the_pilot(
    dive: Dive, opened: Callable[..., Page]
) -> None:
    page = opened(f"/#token={TOKEN}")
    page.evaluate(_HEARD)
    button = page.locator("#alarm")
    assert button.text_content() == "touch for sound"  # a browser plays none before
    page.locator("#banner").click(position={"x": 5, "y": 60})
    _wait(page, "document.querySelector('#alarm').textContent === 'alarm on'")
    _post(dive.port, "/api/kelp/release", TOKEN)  # somebody meant it
    _wait(page, "document.querySelector('#banner').dataset.state === 'IDLE'")
    assert _get(page, "heard.length") == 0
    _active(dive, page, ask_in_s=0.0)
    dive.companion.send_signal(signal.SIGSTOP)
    try:
        _wait(page, "document.body.dataset.stale === 'yes' && heard.length > 0")
        assert set(_get(page, "heard")) == {"running", "vibration"}
        assert button.text_content() == "Silence"
        button.click()
        assert button.text_content() == "alarm on"
        assert page.locator("#state").text_content() == "NO DATA"  # the words stay
        count = _get(page, "heard.length")
        time.sleep(2.5)
        assert _get(page, "heard.length") == count
    finally:
        dive.companion.send_signal(signal.SIGCONT)
    _active(dive, page)


@pytest.mark.parametrize(
    ("state", "reason", "sounds"),
    [
        ("RAMP_DOWN", "the operator released the vehicle", False),
        ("PILOT", "the pilot steers", False),
        ("PILOT", "the flight mode is not the one for steering", False),
        ("IDLE", "the vehicle is disarmed", True),
        ("RAMP_DOWN", "no heartbeat of the ground station", True),
        ("HAND_OVER", "a leak detector is wet", True),
        ("FAULT", "the vehicle is not heard", True),
    ],
)
def test_what_the_alarm_sounds_for(pages: Page, state: str, reason: str, sounds: bool) -> None:
    heard = _get(
        pages,
        "import('/static/alarm.js').then((m) => {"
        " const alarm = new m.Alarm(); alarm.hear('ACTIVE', '', false);"
        f" alarm.hear('{state}', '{reason}', false); return Boolean(alarm.sounds); }})",
    )
    assert heard is sounds


def test_release_is_one_tap_in_every_state(opened: Callable[..., Page]) -> None:
    page = opened(f"/#token={TOKEN}")
    _wait(page, "!document.querySelector('#release').disabled")
    for state in State:
        fed = f"holdfast.link.handlers.status({{...holdfast.link.status, supervisor: {{state: '{state}'}}}})"
        button = "document.querySelector('#release')"
        assert _get(page, f"{fed}, {button}.checkVisibility() && !{button}.disabled"), state
        assert _get(page, f"{fed}, document.querySelector('#clear').checkVisibility()") == (state == "FAULT")
        offered = _get(page, f"{fed}, document.querySelector('#engage').matches('.primary:enabled')")
        assert offered == (state in ("READY", "PILOT"))
        loud = _get(page, f"{fed}, document.querySelector('.primary:enabled, .danger:enabled').id")
        assert loud == {"READY": "engage", "PILOT": "engage", "FAULT": "clear"}.get(state, "release")


def test_the_pilots_page_fits_a_phone_and_leads_to_the_engineers(
    dive: Dive, opened: Callable[..., Page]
) -> None:
    page = opened(f"/?vehicle=kelp#token={TOKEN}", width=390)
    assert page.locator(".panel:visible").count() == 4  # horizon, depth and heading for the map, events
    _wait(page, "!document.querySelector('#release').disabled")
    for name in ("engage", "release", "hold", "wait", "go", "depth-to"):
        box = page.locator(f"#{name}").bounding_box()
        assert box
        assert box["height"] >= 44
        assert box["y"] > 844 / 2, "one thumb does not reach it"
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
    assert _get(page, "document.documentElement.scrollWidth") == 390
    bar = _get(page, "document.querySelector('#commands').getBoundingClientRect().top")
    assert _get(page, "document.querySelector('#said').getBoundingClientRect().bottom") <= bar
    for dialog in ("go", "ask"):
        page.locator(f"#{dialog}").click()
        assert _get(page, _ON_TOP % "release"), "Release is covered"
        page.keyboard.press("Escape")
    with page.expect_navigation():
        page.locator("#other").click()
    assert page.url.endswith("/engineer?vehicle=kelp")
    _active(dive, page)
    page.locator("#tune").click()
    assert _get(page, _ON_TOP % "release")


_COVERED = """(() => {
  const alarm = document.querySelector("#alarm"), range = document.createRange();
  document.querySelector("#state").textContent = "HAND OVER";
  document.querySelector("#meaning").textContent = "ALT_HOLD has it";
  alarm.textContent = "touch for sound"; alarm.dataset.sounds = "yes";
  const box = alarm.getBoundingClientRect();
  return [...document.querySelectorAll("#banner :is(strong, h2, #meaning, p)")].filter((node) => {
    range.selectNodeContents(node);
    const { left, right, top, bottom } = range.getBoundingClientRect();
    return left < box.right && right > box.left && top < box.bottom && bottom > box.top;
  }).map((node) => node.textContent);
})()"""


WIDTHS = (1440, 1024, 390)


def test_the_alarm_covers_no_words(opened: Callable[..., Page]) -> None:
    page = opened("/")
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 844})
        assert _get(page, _COVERED) == [], width


def test_nothing_is_clipped(opened: Callable[..., Page]) -> None:
    page = opened(f"/engineer#token={TOKEN}", live=False)
    _wait(page, "globalThis.holdfast?.count.frames > 2")
    for tuning in ("no", "yes"):
        if tuning == "yes":
            page.locator("#tune").click()
            _wait(page, "document.body.dataset.tuning === 'yes'")
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 844})
            time.sleep(0.4)  # the legends are filled
            assert _get(page, _CLIPPED) == [], (width, tuning)


def test_a_silent_server_is_seen_and_a_new_one_found(dive: Dive, opened: Callable[..., Page]) -> None:
    page = opened(f"/engineer#token={TOKEN}")
    assert page.locator("#state").text_content() == "ACTIVE"
    _watch_stale(page)
    dive.server.send_signal(signal.SIGSTOP)  # the connection stays: half open
    assert _stale_after(page) < STALE_WITHIN_S
    _wait(page, "document.querySelector('#reason').textContent.includes('server is silent')")
    assert page.locator("#state").text_content() == "NO DATA"
    assert page.locator("#meaning").text_content() == "was ACTIVE"
    assert page.locator("#fact-armed").text_content() == "was ARMED"
    assert page.locator("#fact-armed").get_attribute("data-level") == ""
    dive.server.send_signal(signal.SIGCONT)
    _fresh(page)
    _watch_stale(page)
    dive.server.kill()
    dive.server.wait()
    assert _stale_after(page) < STALE_WITHIN_S
    dive.token.write_text("another-token-of-the-test")
    dive.start_dashboard()
    _fresh(page)
    _wait(page, "document.querySelector('#release').disabled")  # what it has opens nothing now
    assert page.locator("#unlocking").is_visible()
    dive.token.write_text(TOKEN)
    dive.server.kill()
    dive.server.wait()
    dive.start_dashboard()
    _fresh(page)
    page.locator("#token").fill(TOKEN)
    page.keyboard.press("Enter")
    _wait(page, "!document.querySelector('#release').disabled")


def test_a_dead_companion_is_seen_and_a_new_one_found(dive: Dive, opened: Callable[..., Page]) -> None:
    page = opened(f"/#token={TOKEN}")
    _watch_stale(page)
    dive.companion.kill()
    dive.companion.wait()
    assert _stale_after(page) < STALE_WITHIN_S
    _wait(
        page,
        "document.querySelector('#reason').textContent === 'No news from kelp. It was ACTIVE and armed.'",
    )
    assert "disarms 3 s after the last frame" in (page.locator("#advice").text_content() or "")
    assert page.locator("#fact-armed").text_content() == "was ARMED"
    assert (page.locator("#fact-age").text_content() or "").startswith("STALE")
    assert [page.locator(f"#{name}").is_disabled() for name in ("engage", "hold", "wait", "go")] == [True] * 4
    dive.start_companion()
    _fresh(page)
    _active(dive, page)


def test_a_vehicle_that_fell_silent_leaves_gaps_and_no_live_picture(
    dive: Dive, opened: Callable[..., Page]
) -> None:
    """The last test of this file: the vehicle does not come back."""
    page = opened()
    dive.vehicle.kill()
    for panel in ("depth", "heading", "attitude"):
        _wait(page, f"document.querySelector('#panel-{panel}').dataset.known === 'no'")
    assert "no attitude for" in (page.locator("#panel-attitude header").text_content() or "")
    assert "nothing new for" in (page.locator("#panel-depth header").text_content() or "")
    assert page.locator("#state").text_content() == "LINK LOST"
    assert page.locator("#banner").get_attribute("data-lost") == "yes"
    assert page.locator("#fact-armed").text_content() == "–"
    assert _get(page, "Number.isNaN(holdfast.store.of['depth_m'][holdfast.store.end - 1])")
    assert _get(page, "document.body.dataset.stale") == "no"  # the companion itself goes on


def _active(dive: Dive, page: Page, ask_in_s: float = ENGAGE_S) -> None:
    """Wait until it holds; engage it again after `ask_in_s`, where a slow machine made it let go."""
    ask_s = time.monotonic() + ask_in_s

    def active() -> bool:
        nonlocal ask_s
        if time.monotonic() > ask_s:
            ask_s = time.monotonic() + ENGAGE_S
            for command in ("clear_fault", "engage"):
                _post(dive.port, f"/api/kelp/{command}", TOKEN)
        return bool(page.evaluate(HOLDS))

    until(active)


def _fresh(page: Page) -> None:
    _wait(page, "document.body.dataset.stale === 'no'")


def _watch_stale(page: Page) -> None:
    """Note how old the data is, by the page's own clock, when the page begins to look stale."""
    page.evaluate(
        "() => { window.staleAt = null; new MutationObserver((_, self) => {"
        " if (document.body.dataset.stale !== 'yes') return;"
        " window.staleAt = holdfast.link.age; self.disconnect();"
        " }).observe(document.body, { attributes: true }); }"
    )


def _stale_after(page: Page) -> float:
    _wait(page, "window.staleAt !== null")
    assert float(_get(page, "getComputedStyle(document.querySelector('#board')).opacity")) < 0.6
    return float(_get(page, "window.staleAt"))


def _get(page: Page, expression: str) -> Any:
    return page.evaluate(expression)


def _wait(page: Page, expression: str) -> None:
    """Wait until it is true. Not Playwright's own: it evaluates strings, which the page's policy refuses."""
    until(lambda: bool(page.evaluate(expression)))


def _network(text: str) -> bool:
    """Tell whether the console says only that the server was away, which some tests see to."""
    return bool(re.search(r"WebSocket connection to|Failed to load resource", text))


def _config(dive: Dive) -> dict[str, Any]:
    with Subscription("holdfast/kelp/config", dive.zenoh) as seen:
        until(lambda: seen.connected)
        answer: dict[str, Any] = json.loads(seen.ask(telemetry.key("kelp", "config")) or b"{}")
        return answer


def _answers(port: int) -> bool:
    try:
        return _request(port, "GET", "/", {})[0] == 200
    except OSError:
        return False


def _post(port: int, path: str, token: str, origin: str | None = "") -> tuple[int, str]:
    headers = {"Authorization": f"Bearer {token}"}
    if origin is not None:
        headers["Origin"] = origin or f"http://127.0.0.1:{port}"
    return _request(port, "POST", path, headers, b"{}")


def _request(
    port: int, method: str, path: str, headers: dict[str, str], body: bytes | None = None
) -> tuple[int, str]:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10)) as connection:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, "" if answer.status == 101 else answer.read().decode()

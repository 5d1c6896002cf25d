"""A headless Chromium, told what to do over a pipe, for tests of pages."""

import base64
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# The browser reads commands from descriptor 3 and answers on 4.
LAUNCH = """
import os, sys
read, write = int(sys.argv[1]), int(sys.argv[2])
high = [os.dup(fd) for fd in (read, write)]
while min(high) < 5:
    high = [os.dup(fd) for fd in high]
os.dup2(high[0], 3)
os.dup2(high[1], 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


def chromium():
    """Path of the browser; None where there is none."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Browser:
    """One page in a fresh profile."""

    def __init__(self, profile: Path, size=(1280, 800), dark=False):
        read_own, write_child = os.pipe()
        read_child, write_own = os.pipe()
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run"]
        options += ["--disable-extensions", "--disable-background-networking", f"--user-data-dir={profile}"]
        options += [f"--window-size={size[0]},{size[1]}", "--hide-scrollbars", "about:blank"]
        launch = [sys.executable, "-c", LAUNCH, str(read_child), str(write_child), str(chromium()), *options]
        with (profile / "log").open("wb") as log:
            self.process = subprocess.Popen(launch, pass_fds=(read_child, write_child), stdout=log, stderr=log)
        os.close(read_child)
        os.close(write_child)
        self.reader, self.writer = os.fdopen(read_own, "rb"), os.fdopen(write_own, "wb", buffering=0)
        self.count, self.session, self.troubles, self.rest = 0, None, [], b""
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.ask("Runtime.enable")
        self.ask("Log.enable")
        self.ask("Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False)
        if dark:
            self.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])

    def ask(self, method, **arguments):
        """The result of a command of the DevTools protocol; what the page complains of meanwhile is kept."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": arguments}
        if self.session is not None:
            message["sessionId"] = self.session
        self.writer.write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self.receive()
            if answer.get("method") == "Runtime.exceptionThrown":
                self.troubles.append(json.dumps(answer["params"]["exceptionDetails"])[:2000])
            elif answer.get("method") == "Log.entryAdded" and answer["params"]["entry"]["level"] == "error":
                self.troubles.append(answer["params"]["entry"]["text"])
            if answer.get("id") == self.count:
                assert "error" not in answer, answer
                return answer["result"]

    def receive(self):
        while b"\0" not in self.rest:
            more = self.reader.read1(1 << 20)
            assert more, "the browser went away"
            self.rest += more
        line, _, self.rest = self.rest.partition(b"\0")
        return json.loads(line)

    def open(self, url, until="document.readyState === 'complete'"):
        self.ask("Page.navigate", url=url)
        self.wait(until)

    def value(self, script):
        """What the script comes to in the page."""
        result = self.ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, script, seconds=60.0):
        """Until the script comes to something true."""
        ends = time.monotonic() + seconds
        while not self.value(f"Boolean({script})"):
            assert time.monotonic() < ends, f"not within {seconds} s: {script}; {self.troubles}"
            time.sleep(0.05)

    def drag(self, start, *places):
        """Press the mouse at the first place, move it over the others, and let go."""
        self.mouse("mouseMoved", start)
        self.mouse("mousePressed", start, button="left", buttons=1, clickCount=1)
        for place in places:
            self.mouse("mouseMoved", place, button="left", buttons=1)
        self.mouse("mouseReleased", places[-1] if places else start, button="left", clickCount=1)

    def mouse(self, kind, place, **more):
        self.ask("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], **more)

    def press(self, key):
        code = {"Delete": 46, "ArrowRight": 39, " ": 32}[key]
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code)

    def picture(self, path: Path):
        """Write what is seen as a PNG."""
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))

    def close(self):
        self.session = None
        try:
            self.ask("Browser.close")
        except (AssertionError, OSError):
            self.process.kill()
        self.process.wait(timeout=30)
        self.reader.close()
        self.writer.close()

"""Helpers for tests of deployment: small wheels, drones' files, an ssh server."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import zipfile
from pathlib import Path

from companion.__main__ import main

DRONE = """fileversion: 2
name: {name}
link: {{system_id: {i}, endpoint: 'udpin:127.0.0.1:{port}'}}
camera: {{source: 'sim:127.0.0.1:{frames}'}}
"""


SYSTEMCTL = """
import json, pathlib, sys
given = json.loads(sys.argv[1])
log = pathlib.Path(given["log"])
with log.open("a") as f:
    f.write(" ".join(sys.argv[2:]) + "\\n")
if sys.argv[2] == "show":
    unit = sys.argv[-1]
    print(given["states"].get(unit, given["state"]))
    if given["starts"]:
        print("InvocationID=%d" % log.read_text().count(f"restart --no-block {unit}"))
if sys.argv[2] == "restart" and given["writes"]:
    path, text = given["writes"]
    pathlib.Path(path).parent.mkdir(parents=True, exist_ok=True)
    pathlib.Path(path).write_text(text)
"""


def fake_systemctl(folder, state, states=None, starts=True, writes=None):
    """Return a stand-in for systemctl that logs its calls and answers `show` with `state`.

    states: by unit, where they differ. starts: whether a restart makes a new invocation. writes: a
    file and its text that a restart writes.
    """
    script = folder / "systemctl.py"
    script.write_text(SYSTEMCTL)
    given = {
        "log": str(folder / "asked"),
        "state": state,
        "states": states or {},
        "starts": starts,
        "writes": writes and [str(w) for w in writes],
    }
    return [sys.executable, str(script), json.dumps(given)]


_BLOCK = 20  # ports that are claimed together
_claims = []  # sockets, open as long as this process


def _claim(block):
    """Claim a block of ports among all tests of this machine; None where it is taken."""
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        claim.bind(f"\0swarm-tests/ports/{block}")
    except OSError:
        claim.close()
        return None
    return claim


def free_ports(count):
    """Return a base so that base … base+count are free for TCP and UDP just now.

    No other test gets them while this process lives: most are bound only later, by a daemon.
    """
    first = 20000 + os.getpid() % 9000 // _BLOCK * _BLOCK
    for base in range(first, 32000, _BLOCK * (count // _BLOCK + 1)):
        claims = [_claim(block) for block in range(base, base + count + 1, _BLOCK)]
        if None in claims:
            continue
        _claims.extend(claims)
        try:
            for port in range(base, base + count + 1):
                for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
                    with socket.socket(socket.AF_INET, kind) as s:
                        s.bind(("127.0.0.1", port))
        except OSError:
            continue
        return base
    raise RuntimeError("no free ports")


def write_drones(folder, names, more=""):
    """Write drones without conflicts, and a default.yaml below them; return their files."""
    folder.mkdir(exist_ok=True)
    (folder / "default.yaml").write_text("fileversion: 2\nmission: {tolerance: 2.0}\n")
    files = []
    for i, name in enumerate(names, start=1):
        files.append(folder / f"{name}.yaml")
        text = DRONE.format(name=name, i=i, port=24000 + i, frames=25000 + i)
        files[-1].write_text(text + more)
    return files


def small_wheel(folder, version, check=0):
    """Make a wheel whose `companion` prints its version and exits with `check`."""
    folder.mkdir(exist_ok=True)
    path = folder / f"swarm_companion-{version}-py3-none-any.whl"
    info = f"swarm_companion-{version}.dist-info"
    files = {
        "companion/__init__.py": "",
        "companion/__main__.py": f"import sys\nprint('version {version}')\nsys.exit({check})\n",
        "companion/board/locks/base.txt": "",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: swarm-companion\nVersion: {version}\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\n"
        "Tag: py3-none-any\n",
    }
    record = "".join(f"{name},,\n" for name in [*files, f"{info}/RECORD"])
    with zipfile.ZipFile(path, "w") as wheel:
        for name, text in {**files, f"{info}/RECORD": record}.items():
            wheel.writestr(zipfile.ZipInfo(name), text)
    return path


def deploy(files, wheel, root, *more):
    """Run `companion deploy` into a root directory; return its exit status."""
    return main(["deploy", *map(str, files), "--wheel", str(wheel), "--root", str(root), *more])


def files_of(folder):
    """Return the files of the drones alpha and beta."""
    return [folder / "drones" / f"{n}.yaml" for n in ("alpha", "beta")]


def launched(root):
    """Return the output of the installed launcher of `root`."""
    launcher = root / "opt/swarm-companion/companion"
    return subprocess.run([launcher, "run"], capture_output=True, text=True).stdout.strip()


def contents(root):
    """Return every file below root but the environments, with time, mode and bytes."""
    return {
        str(p.relative_to(root)): (
            p.lstat().st_mtime_ns,
            p.lstat().st_mode,
            p.readlink() if p.is_symlink() else p.read_bytes(),
        )
        for p in root.rglob("*")
        if (p.is_symlink() or p.is_file()) and "releases/" not in str(p) and p.name != ".lock"
    }


class SshServer:
    """A real sshd on a free port of the loopback, with keys of its own."""

    def __init__(self, folder, port):
        self.folder = folder
        for key in ("host", "user"):
            subprocess.run(
                ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / key], check=True
            )
        (folder / "authorized").write_bytes((folder / "user.pub").read_bytes())
        (folder / "sshd_config").write_text(
            f"ListenAddress 127.0.0.1\nPort {port}\nHostKey {folder}/host\nPidFile none\n"
            f"AuthorizedKeysFile {folder}/authorized\nStrictModes no\nUsePAM no\n"
            "PermitRootLogin yes\nPasswordAuthentication no\n"
        )
        if not os.getuid():
            Path("/run/sshd").mkdir(exist_ok=True)  # where sshd drops its privileges
        self.log = (folder / "sshd.log").open("wb")
        self.process = subprocess.Popen(
            [sshd_path(), "-D", "-e", "-f", folder / "sshd_config"], stderr=self.log
        )
        self.shell = (
            f"ssh -p {port} -i {folder}/user -o BatchMode=yes -o ConnectTimeout=5 "
            f"-o StrictHostKeyChecking=no -o UserKnownHostsFile={folder}/known -o LogLevel=ERROR"
        )
        deadline = time.monotonic() + 10.0
        while b"Server listening" not in (folder / "sshd.log").read_bytes():
            assert time.monotonic() < deadline, (folder / "sshd.log").read_text()
            time.sleep(0.05)

    def close(self):
        self.process.terminate()
        self.process.wait()
        self.log.close()


def sshd_path():
    """Return the full path of sshd, which it must be called by; None: not installed."""
    return shutil.which("sshd", path="/usr/sbin:/usr/local/sbin:/sbin:/usr/bin")

"""`make` on other people's machines, with stand-ins for the tools that they may lack."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NEEDED = ("bash", "sh", "cp", "cut", "env", "find", "head", "mkdir", "rm", "sort", "touch", "make")

# What set-up does once there is an interpreter.
ALL = ["python pip", "python pip", "maturin develop"]

# Stands for an interpreter; what it is asked to install is written down instead.
PYTHON = f"""#!/bin/sh
asked="${{0##*/}} $*"
case "$1 $2" in
  "-c "*) exec {sys.executable} "$@" ;;
  "-m venv")
    shift 2; [ "$1" = --clear ] && shift
    mkdir -p "$1/bin"
    for name in python pip maturin trihedral; do cp "$0" "$1/bin/$name"; done ;;
esac
echo "$asked" >> "$LOG"
"""


@pytest.fixture
def machine(tmp_path):
    """A checkout, and a PATH with nothing on it but what the test puts there."""
    tools, project = tmp_path / "tools", tmp_path / "project"
    tools.mkdir()
    (project / "core/src").mkdir(parents=True)
    (project / "bindings/src").mkdir(parents=True)
    for name in NEEDED:
        (tools / name).symlink_to(shutil.which(name))
    for name in (
        *("Makefile", "pyproject.toml", "constraints.txt", "Cargo.toml", "Cargo.lock", "core/Cargo.toml"),
        *("bindings/Cargo.toml", "tools/find.sh"),
    ):
        (project / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, project / name)
    (project / "core/src/lib.rs").touch()
    return Machine(tools, project, tmp_path / "log")


class Machine:
    def __init__(self, tools: Path, project: Path, log: Path) -> None:
        self.tools, self.project, self.log = tools, project, log

    def has(self, name: str, script: str) -> "Machine":
        (self.tools / name).write_text(script)
        (self.tools / name).chmod(0o755)
        return self

    def has_all(self) -> "Machine":
        self.has("python3", PYTHON).has("cc", "#!/bin/sh\n")
        return self.has("cargo", "#!/bin/sh\necho cargo 1.90.0\n")

    def make(self, *arguments: str, **environment: str) -> tuple[int, str]:
        run = subprocess.run(
            ["make", *arguments],
            cwd=self.project,
            env={"PATH": str(self.tools), "HOME": str(self.project), "LOG": str(self.log), **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        return run.returncode, run.stdout

    def did(self) -> list[str]:
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        self.log.unlink(missing_ok=True)
        return [line.split(" ")[0] + " " + line.split(" ")[2 if " -m " in line else 1] for line in lines]


@pytest.mark.parametrize("goal", ["demo", "test", "setup"])
@pytest.mark.parametrize(
    ("tool", "script", "says"),
    [
        ("python3", None, "Python 3.11 or newer: install python3"),
        ("python3", "echo 3.9.2; exit 1", "Python 3.11 or newer (found 3.9.2): install python3"),
        ("cargo", None, "install it with rustup"),
        ("cargo", "echo cargo 1.75.0", "Rust 1.88 or newer (found 1.75.0): run rustup update stable"),
        ("cargo", "exit 1", "install it with rustup"),
        ("cc", None, "install gcc or clang"),
        (
            "python3",
            f'case "$2" in *ensurepip*) exit 1;; *) exec {sys.executable} "$@";; esac',
            "install python3-venv",
        ),
    ],
)
def test_a_missing_or_old_tool_is_one_line_that_says_what_to_install(machine, goal, tool, script, says):
    machine.has_all()
    (machine.tools / tool).unlink()
    if script is not None:
        machine.has(tool, f"#!/bin/sh\n{script}\n")
    code, output = machine.make(goal)
    assert code != 0
    assert len(output.splitlines()) == 1
    assert says in output
    assert not (machine.project / ".venv").exists(), "nothing is begun that cannot be finished"


def test_a_newer_python_under_its_own_name_is_found(machine):
    machine.has_all().has("python3", "#!/bin/sh\necho 3.9.2; exit 1\n").has("python3.12", PYTHON)
    assert machine.make("setup")[0] == 0
    assert machine.did()[0] == "python3.12 venv"


def test_set_up_does_what_changed_and_nothing_twice(machine):
    machine.has_all()
    assert machine.make("setup")[0] == 0
    assert machine.did() == ["python3 venv", *ALL]
    assert machine.make("setup")[0] == 0
    assert machine.did() == []
    for changed, done in {
        "core/src/lib.rs": ["maturin develop"],
        "constraints.txt": ALL,
    }.items():
        later = (machine.project / ".venv/.built").stat().st_mtime + 10
        os.utime(machine.project / changed, (later, later))
        assert machine.make("setup")[0] == 0
        assert machine.did() == done, changed
        os.utime(machine.project / changed, (0, 0))


def test_an_environment_that_was_cut_short_or_lost_its_python_is_made_anew(machine):
    machine.has_all()
    machine.make("setup")
    machine.did()
    (machine.project / ".venv/bin/pip").unlink()
    (machine.project / ".venv/.installed").unlink()
    machine.make("setup")
    assert machine.did() == ["python3 venv", *ALL]
    (machine.project / ".venv/bin/python").write_text("#!/nowhere/python\n")
    machine.make("setup")
    assert machine.did() == ["python3 venv", *ALL]


def test_another_active_environment_does_not_leak_in(machine):
    machine.has_all()
    machine.has(
        "python3",
        PYTHON.replace("echo ", 'echo "${VIRTUAL_ENV-}${PYTHONPATH-}${CONDA_PREFIX-}" >> "$LOG"; echo '),
    )
    machine.make("setup", VIRTUAL_ENV="/other", PYTHONPATH="/other", CONDA_PREFIX="/other")
    assert "/other" not in machine.log.read_text()


def test_help_and_clean_need_nothing(machine):
    assert machine.make("help")[0] == 0
    assert machine.make("clean")[0] == 0


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    maturin = Path(sys.executable).with_name("maturin")
    subprocess.run([maturin, "build", "--release", "--quiet", "--out", folder], cwd=ROOT, check=True)
    (file,) = folder.iterdir()
    return file


def test_the_wheel_serves_every_python_from_3_11_on(wheel):
    assert "-cp311-abi3-" in wheel.name


def test_the_wheel_installs_and_runs_without_rust(wheel, tmp_path):
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "fresh"], check=True)
    python = tmp_path / "fresh/bin/python"
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel],
        check=True,
        env=environment,
    )
    # The other packages come from the environment that runs this test; without its path files, which would
    # lead to this checkout.
    packages = tmp_path / "packages"
    packages.mkdir()
    for entry in (
        Path(shutil.which("pytest", path=str(Path(sys.executable).parent)))
        .parents[1]
        .glob("lib/python*/site-packages/*")
    ):
        if not entry.name.startswith("trihedral") and entry.suffix != ".pth":
            (packages / entry.name).symlink_to(entry)
    code = "import trihedral._core as c, trihedral; print(c.__file__); trihedral.register"
    run = subprocess.run(
        [python, "-c", code], env=environment | {"PYTHONPATH": str(packages)}, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(str(tmp_path))
    command = subprocess.run(
        [tmp_path / "fresh/bin/trihedral", "--version"],
        env=environment | {"PYTHONPATH": str(packages)},
        capture_output=True,
        text=True,
    )
    assert command.stdout.startswith("trihedral "), command.stderr

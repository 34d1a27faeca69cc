"""The extras of `pip install "dronecats[…]"`: their features and their packages."""

from dataclasses import dataclass
from importlib.util import find_spec

from foundation.errors import UsageError

OWN_PACKAGES = ("foundation", "dronecats", "autopilot", "vehicles", "episodes", "hil", "benchmarks", "examples")
BASE_COMMAND = 'pip install "dronecats"'


@dataclass(frozen=True, slots=True)
class Extra:
    """An extra of pyproject.toml."""

    name: str
    enables: str
    modules: tuple[str, ...]  # import names of the packages that the extra adds

    @property
    def command(self) -> str:
        """The command that installs the extra."""
        return f'pip install "dronecats[{self.name}]"'


# If several extras add the same package, messages recommend the first of them.
EXTRAS = (
    Extra(
        "sim",
        "simulated flights, figures, reports, benchmarks",
        ("numba", "embreex", "matplotlib", "PIL", "tqdm", "psutil"),
    ),
    Extra("vision", "signs and plates for the pilot vision", ("rapidocr", "onnxruntime")),
    Extra("view", "browser pages: replay, edit, --view", ("viser",)),
    Extra("film", "films in H.264 instead of MPEG-4 part 2", ("imageio_ffmpeg",)),
    Extra("query", "query; export --to csv, export --to parquet", ("duckdb",)),
    Extra("export", "export --to mcap", ("mcap", "mcap_protobuf", "foxglove_schemas_protobuf")),
    Extra("rerun", "export --to rerun", ("rerun",)),
    Extra("lerobot", "export --to lerobot", ("pyarrow",)),
    Extra("ulog", "flightlog trace --ulog", ("pyulog",)),
    Extra("serial", "serial links: --connect serial://…", ("serial",)),
    Extra("cluster", "bench --engine ray, study run --engine ray", ("ray",)),
    Extra("gymnasium", "episodes as a Gymnasium environment", ("gymnasium",)),
    Extra("inspect", "episodes as Inspect and Inspect Robots tasks", ("inspect_ai", "inspect_robots")),
    Extra("train", "examples/action_head, which trains a pilot", ("torch", "pyarrow")),
    Extra("docs", "make docs", ("sphinx", "myst_parser", "furo")),
    Extra(
        "dev",
        "make test, benchmarks.page",
        (
            *("pytest", "xdist", "pytest_timeout", "hypothesis", "importlinter", "ruff", "mypy", "build", "setuptools"),
            *("jsonschema", "statsmodels", "trimesh", "pyogrio", "selenium", "openai", "google.genai", "anthropic"),
        ),
    ),
)


def extra_of(module: str) -> Extra | None:
    """Return the extra that adds an imported module; None if no extra does."""
    return next((extra for extra in EXTRAS for name in extra.modules if f"{module}.".startswith(f"{name}.")), None)


def is_installed(module: str) -> bool:
    """Return whether a module is installed, without importing it."""
    try:
        return find_spec(module) is not None
    except ImportError:
        return False


def require(*modules: str) -> None:
    """Raise UsageError for the first module that is not installed, with its install command.

    Nothing is imported, so that a command can check what it needs before it flies or writes anything.
    """
    for module in modules:
        if not is_installed(module):
            raise UsageError(not_installed(module))


def not_installed(module: str) -> str:
    """Return the message about a missing package, with the command that installs it."""
    extra = extra_of(module)
    return f"the package {module} is not installed: {extra.command if extra else BASE_COMMAND}"


def missing_package(error: ImportError) -> str | None:
    """Return the message about a failed import; None if the module is the project's own, because that is a bug."""
    if error.name is None:
        return f"a package cannot be loaded: {error}"
    if error.name.split(".")[0] in OWN_PACKAGES:
        return None
    if isinstance(error, ModuleNotFoundError):
        return not_installed(error.name)
    return f"the package {error.name} cannot be loaded: {error}"

"""Where the project's data folders are, in a checkout and in an installed wheel."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
# A checkout keeps the folders beside the package; the wheel carries them in spin_rl/_data.
_ROOT = _PACKAGE / "_data" if (_PACKAGE / "_data").is_dir() else _PACKAGE.parent

ROBOT_XML: Path = _ROOT / "robots" / "stretch_re1" / "stretch_re1.xml"
CONF_DIR: Path = _ROOT / "conf"
POLICY_DIR: Path = _ROOT / "policies"
RESULT_DIR: Path = _ROOT / "results"

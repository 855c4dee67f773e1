"""Stored outputs and figures of the examples, so that a build of the documentation shows them without running minutes of examples.

``python docs/_scripts/gallery.py [NAME ...]`` runs all examples, or some, and stores what they print and draw in ``docs/_gallery``.
A build shows what is stored for an example whose code is the same (its texts may change). Other examples are shown unrun.
Tutorials (``tutorial_*.py``) run in every build. ``SKSURROGATE_GALLERY=1`` runs all of them in the build.
"""

import ast
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType

from sphinx_gallery import gen_rst

HERE = Path(__file__).parents[1]
STORE = HERE / "_gallery"
#: "" (show what is stored), "1" (run all), "store" (run and store).
MODE = os.environ.get("SKSURROGATE_GALLERY", "")
#: Names of examples that are run and stored; all where empty.
CHOSEN = os.environ.get("SKSURROGATE_GALLERY_NAMES", "").split()

run_block = gen_rst._exec_and_get_memory
run_script = gen_rst.execute_script


def run_block_or_stop(compiler, *, script_vars, **more):
    """An example that lacks its data leaves with ``SystemExit(0)``: that ends the example, not the build."""
    try:
        return run_block(compiler, script_vars=script_vars, **more)
    except SystemExit as stop:
        if stop.code:
            raise RuntimeError(f"the example left with status {stop.code}") from stop
        script_vars["execute_script"] = False
        return False, 0.0


def digest(source):
    """Hash of an example's code, comments and docstring of the script left out."""
    tree = ast.parse(Path(source).read_text(encoding="utf-8"))
    return hashlib.sha256("".join(ast.dump(node) for node in tree.body[1:]).encode()).hexdigest()[:16]


def execute_script(script_blocks, script_vars, gallery_conf, file_conf):
    """In the place of sphinx-gallery's function of this name: the stored outputs, or a run."""
    name = Path(script_vars["src_file"]).stem
    stored = STORE / f"{name}.json"
    known = json.loads(stored.read_text(encoding="utf-8")) if stored.exists() else {}
    same = known.get("code") == digest(script_vars["src_file"]) and len(known["outputs"]) == len(script_blocks)
    wanted = MODE == "1" or name.startswith("tutorial_") or (MODE == "store" and (not CHOSEN or name in CHOSEN))
    if same and not wanted:
        return from_store(known, name, script_vars)
    if not wanted:
        script_vars["execute_script"] = False
    outputs, seconds = run_script(script_blocks, script_vars, gallery_conf, file_conf)
    if MODE == "store" and not name.startswith("tutorial_") and script_vars.get("passing"):
        keep(name, outputs, script_vars)
    return outputs, seconds


def from_store(known, name, script_vars):
    """Outputs as they were stored; figures go where sphinx-gallery expects them."""
    for number in range(known["figures"]):
        Path(script_vars["image_path_iterator"].next()).write_bytes((STORE / f"{name}_{number + 1}.png").read_bytes())
    script_vars.update(example_globals={}, fake_main=ModuleType("__main__"), memory_delta=0.0, passing=True)
    *before, last = known["outputs"]
    return [*before, f"{last}\n\n*Output and figures were stored at commit {known['commit']}.*\n\n"], 0.0


def keep(name, outputs, script_vars):
    """Store outputs and figures (in 256 colours, which is enough for plots)."""
    from PIL import Image

    STORE.mkdir(exist_ok=True)
    count = len(script_vars["image_path_iterator"])
    for old in STORE.glob(f"{name}_*.png"):
        old.unlink()
    for number in range(1, count + 1):
        path = script_vars["image_path_iterator"].image_path.format(number)
        Image.open(path).convert("RGB").quantize(256).save(STORE / f"{name}_{number}.png", optimize=True)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True)
    outputs = [re.sub(r"(?m)^( *)(\S*/)?[^ \n]*site-packages/\S*", r"\1...", text) for text in outputs]
    known = {
        "code": digest(script_vars["src_file"]),
        "commit": commit.stdout.strip(),
        "figures": count,
        "outputs": outputs,
    }
    (STORE / f"{name}.json").write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")


def leave(app):
    """Stored is all that was asked for: no page is built."""
    if MODE == "store":
        raise SystemExit(0)


def use_store(app):
    """Put the functions of this module into sphinx-gallery."""
    gen_rst._exec_and_get_memory = run_block_or_stop
    gen_rst.execute_script = execute_script
    app.connect("builder-inited", leave, priority=990)  # behind the gallery


if __name__ == "__main__":
    more = {"SKSURROGATE_GALLERY": "store", "SKSURROGATE_GALLERY_NAMES": " ".join(sys.argv[1:])}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "sphinx", "-E", "-q", "-b", "html", str(HERE), folder]
        raise SystemExit(subprocess.call(command, env={**os.environ, **more}))

"""Assembles the source of the site in ``target/site``: pages, specifications, docstrings.

    python py/docs/assemble.py && mkdocs build --strict -f py/mkdocs.yml

``.ci/site`` does both. What goes where:

- the pages of this folder, CHANGELOG.md, and all in the repository that they link to, to ``pages``,
  with links that fit there; the marks behind quoted figures are left out;
- a page for each environment, made of its docstring, to ``pages/environments``;
- a page of the reference for each entry of `REFERENCE` to ``pages/api``;
- the package with the docstrings that its compiled part and its environments have only when they
  are imported, to ``python``, where the reference is read from.
"""

from __future__ import annotations

import argparse
import ast
import copy
import inspect
import os
import re
import shutil
from pathlib import Path

from ruffini import TASKS, _core, agents, envs

ROOT = Path(__file__).resolve().parents[2]
DOCS, SITE = ROOT / "py/docs", ROOT / "target/site"
PAGES, PYTHON = SITE / "pages", SITE / "python"
CHANGELOG = ROOT / "py/CHANGELOG.md"

REFERENCE = {
    "environments": ("Environments", ["envs.NativeEnv", "envs.NativeVectorEnv"]),
    "custom": ("Tasks of your own", ["custom"]),
    "agents": (
        "Agents, policies, evaluation",
        [
            *("agents", "agents.training", "agents.params", "agents.sb3"),
            *("sb3", "policies", "evaluation", "video"),
        ],
    ),
    "mechanics": (
        "Mechanics of soft bodies",
        [
            *("Shape", "TetMesh", "SoftBody", "sensor", "Press", "History", "Deformation", "Fem"),
            *("Compliance", "LinearPad", "Surrogate", "SoftSurrogate", "PaperNetwork"),
            *("PaperAnswer", "Skin", "Grasp", "Grasped", "Transfer", "objects", "Object"),
            "Antipodal",
            *("plot", "relative_error", "SimulationError", "PressError", "OutsideTrainingWarning"),
        ],
    ),
    "datasets": ("Datasets and networks", ["dataset", "surrogate"]),
}
"""Pages of the reference: title, and what of the package is on them."""

LINK = re.compile(r"(!?\[[^\]]*\]\()(?!https?://|#|mailto:)([^)#\s]+)(#[^)\s]*)?\)")
MARK = re.compile(r"<!--.*?-->")
ROLE = re.compile(r":(?:class|meth|func|mod|attr):`~?([^`]+)`")


def place(file: Path) -> Path:
    """Place in `PAGES` of a file of the repository."""
    if file == CHANGELOG:
        return Path("changelog.md")
    return file.relative_to(DOCS if file.is_relative_to(DOCS) else ROOT)


def way(start: Path, end: Path) -> str:
    """Relative link from one page to another file, both places in `PAGES`."""
    return Path(os.path.relpath(end, start.parent)).as_posix()


def copied(file: Path) -> list[Path]:
    """Copies a page or another file to its place; the files of the repository that it links to."""
    target = PAGES / place(file)
    target.parent.mkdir(parents=True, exist_ok=True)
    if file.suffix != ".md":
        shutil.copy(file, target)
        return []
    linked = []

    def fitted(link: re.Match[str]) -> str:
        end = (file.parent / link[2]).resolve()
        if not end.is_file():
            raise FileNotFoundError(f"{file.relative_to(ROOT)} links to {link[2]}")
        linked.append(end)
        return f"{link[1]}{way(place(file), place(end))}{link[3] or ''})"

    text = LINK.sub(fitted, MARK.sub("", file.read_text()))
    if file == DOCS / "tasks.md":
        text = with_specifications(text)
    if file == DOCS / "index.md":
        text = with_reference(text)
    if place(file).parts[0] in ("policies", "tests"):
        # A search finds the pages on a matter before the reports behind them.
        text = f"---\nsearch: {{boost: 0.5}}\n---\n\n{text}"
    target.write_text(text)
    return linked


def with_specifications(text: str) -> str:
    """The page of the tasks, a link to its specification under the heading of each."""
    for task in TASKS:
        link = f"[Specification, settings, a moving picture](environments/{task}.md)"
        text = text.replace(f"\n## {task}\n", f"\n## {task}\n\n{link}\n")
    return text


def with_reference(text: str) -> str:
    """The first page, links to the reference in the row that says how to find a function."""
    links = ", ".join(f"[{title}](api/{name}.md)" for name, (title, _) in REFERENCE.items())
    return re.sub(r"(\| look up a class or function \| ).*(?= \|)", rf"\1{links}", text)


def pages() -> None:
    """Copies the pages and all that they link to, directly or not."""
    left = [*sorted(DOCS.glob("*.md")), CHANGELOG]
    done: set[Path] = set()
    while left:
        file = left.pop()
        if file not in done:
            done.add(file)
            left += copied(file)


def environment(task: str) -> str:
    """Page of a task's environment, made of its docstring."""
    env = getattr(envs, f"{task}Env")
    text, _, _ = inspect.cleandoc(env.__doc__).partition("\nArgs:")
    summary, _, text = text.partition("\n")
    text = re.sub(r":class:`(\w+)Env`", r"[\1](\1.md)", text)
    text = ROLE.sub(r"`\1`", text.replace("``", "`"))
    names = [name.split("-v")[0] for name in agents.names()]
    play = f"ruffini play {task}" + ("" if task in names else " --policy scripted")
    return f"""# {task}

{summary}

![Episodes of {task}](../{task}.gif)

```python
import gymnasium, ruffini

env = gymnasium.make("ruffini/{task}-v0")
observation, info = env.reset(seed=0)
print({{name: values.shape for name, values in observation.items()}})
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
```

`gymnasium.make_vec("ruffini/{task}-v0", num_envs=64)` makes a batch of them; `{play}` shows it.
What it is about and how well it is solved: [Tasks](../tasks.md#{task.lower()}).
Methods: [reference](../api/environments.md).
{text}
"""


def generated() -> None:
    """Writes the pages of the environments and of the reference."""
    shutil.copy(DOCS / "site.css", PAGES)
    for task in TASKS:
        (PAGES / "environments").mkdir(parents=True, exist_ok=True)
        (PAGES / f"environments/{task}.md").write_text(environment(task))
        shutil.copy(DOCS / f"{task}.gif", PAGES)
    for name, (title, members) in REFERENCE.items():
        text = "\n\n".join([f"# {title}", *(f"::: ruffini.{member}" for member in members)])
        (PAGES / "api").mkdir(parents=True, exist_ok=True)
        (PAGES / f"api/{name}.md").write_text(text + "\n")


def documented(source: str, thing: object) -> str:
    """Source of a module, with the docstrings that its members have when they are imported."""
    tree = ast.parse(source)

    def add(nodes: list[ast.stmt], owner: object) -> None:
        for node in nodes:
            if not isinstance(node, ast.ClassDef | ast.FunctionDef):
                continue
            member = getattr(owner, node.name, None)
            if isinstance(node, ast.ClassDef):
                add(node.body, member)
            elif node.name == "__new__":
                # Readers, and tools that read, look for arguments there.
                node.name, node.args.args[0].arg = "__init__", "self"
                node.returns = ast.Constant(None)
            text = inspect.getdoc(member)
            if text and ast.get_docstring(node) is None and not node.name.startswith("__"):
                node.body.insert(0, ast.Expr(ast.Constant(text)))

    add(tree.body, thing)
    return ast.unparse(tree)


class _Plain(ast.NodeTransformer):
    """Writes out what annotations and defaults call by private names of the module."""

    def __init__(self, tree: ast.Module) -> None:
        self.meaning: dict[str, ast.expr] = {}
        for node in tree.body:
            target = node.targets[0] if isinstance(node, ast.Assign) else None
            target = node.target if isinstance(node, ast.AnnAssign) else target
            if isinstance(target, ast.Name) and target.id.startswith("_") and node.value:
                self.meaning[target.id] = node.value

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Replaces a private name by its value."""
        meant = self.meaning.get(node.id)
        return node if meant is None else self.visit(copy.deepcopy(meant))


def plain(source: str) -> str:
    """Source of a module whose signatures and bases are without private names."""
    tree = ast.parse(source)
    names = _Plain(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            names.visit(node.args)
            node.returns = node.returns and names.visit(node.returns)
        elif isinstance(node, ast.ClassDef):
            known = [base for base in node.bases if not ast.unparse(base).startswith("_")]
            node.bases = known
            for line in node.body:
                if isinstance(line, ast.AnnAssign):
                    line.annotation = names.visit(line.annotation)
    return ast.unparse(tree)


def package() -> None:
    """Copies the package, docstrings written out, for the reference to be read from."""
    shutil.copytree(
        ROOT / "py/python/ruffini", PYTHON / "ruffini", ignore=shutil.ignore_patterns("*.so")
    )
    stub = PYTHON / "ruffini/_core.pyi"
    stub.with_suffix(".py").write_text(documented(stub.read_text(), _core))
    stub.unlink()
    for file in PYTHON.rglob("*.py"):
        # reStructuredText of the docstrings that Markdown does not know.
        text = ROLE.sub(r"`\1`", file.read_text())
        file.write_text(plain(re.sub(r"::\n\n", ":\n\n", text)))


def main() -> None:
    """Makes the source of the site anew."""
    argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0]).parse_args()
    assemble()


def assemble() -> None:
    """Makes pages and package in folders that are emptied first."""
    for folder in (PAGES, PYTHON):
        shutil.rmtree(folder, ignore_errors=True)
    pages()
    generated()
    package()


if __name__ == "__main__":
    main()

"""How the documentation is built: `make docs`, warnings as errors, no network."""

from __future__ import annotations

import ast
import importlib
import itertools
import pkgutil
import re
from importlib import metadata
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.domains.python import PyObject
from sphinx.ext import napoleon
from sphinx.util.nodes import make_refnode

project = "bodyimage_kin"
author = "The bodyimage_kin developers"
copyright = author
release = version = metadata.version("bodyimage-kin")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_gallery.gen_gallery"]
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "examples"]
html_theme = "furo"
html_title = "bodyimage_kin"
html_static_path = ["_static"]
html_css_files = ["tables.css", "gallery.css", "landing.css"]
html_copy_source = False
pygments_style, pygments_dark_style = "friendly", "native"

default_role = "py:obj"
add_module_names = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

# The examples run at every build, for what they show depends on the package as well, and leave no times on the pages.
sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "within_subsection_order": "FileNameSortKey",
    "run_stale_examples": True,
    "capture_repr": (),
    "image_srcset": ["2x"],
    "doc_module": "bodyimage_kin",
    "reference_url": {"bodyimage_kin": None},
    "download_all_examples": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,
    "show_signature": False,
}

nitpicky = True
# Types in signatures need no page: those of other libraries, jaxtyping's shapes (a `*` cuts them in two), helpers of
# our own. Names that pages link to are checked by tests/test_docs.py, functions and methods that docstrings link to are
# checked here.
nitpick_ignore_regex = [
    ("py:class", r"[A-Z]\w*|'.*'|'|[ \w]*'|bodyimage_kin\.[\w.]+|st\.SearchStrategy|optional"),
    ("py:.*", r"(numpy|np|torch|xr|xarray|pandas|scipy|jaxtyping|matplotlib|hypothesis|mujoco|pinocchio|trimesh)\..*"),
    ("py:.*", r"(collections|pathlib|os|typing|abc|types|datetime|concurrent|dataclasses|enum|random|logging)\..*"),
    ("py:.*", r"(str|int|float|bool|bytes|object|type|tuple|list|dict|None|ndarray)"),
    ("py:attr", r".*"),  # fields are listed with their class, and have no place of their own
    ("py:.*", r"_\w+"),
]


def _reexported(package: str) -> list[str]:
    """The public names of a package: what its ``__init__`` imports ``as`` itself, and what it defines."""
    tree = ast.parse(Path(str(importlib.import_module(package).__file__)).read_text(encoding="utf-8"))
    names = []
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            names += [alias.name for alias in node.names if alias.asname == alias.name]
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.append(node.name)
    return [name for name in names if not name.startswith("_")]


# Autodoc takes imported names from `__all__` alone; rooms without one re-export as `from module import Name as Name`.
for _package in ("backends", "body", "body_image", "estimators", "metrics", "recordings", "study", "testing"):
    _module = importlib.import_module(f"bodyimage_kin.{_package}")
    if not hasattr(_module, "__all__"):
        _module.__all__ = _reexported(f"bodyimage_kin.{_package}")


def _resolve(app: Sphinx, env: Any, node: Any, contnode: nodes.Element) -> nodes.Element | None:
    """Finds a Python name that was written otherwise than documented: ``bodyimage_kin.robot.Robot``, ``Robot.n``."""
    domain = env.get_domain("py") if node.get("refdomain") == "py" else None
    if domain is None:
        return None
    parts = node["reftarget"].lstrip(".~").split(".")
    # `Class.method` keeps its class, so that methods of one name are told apart.
    wanted = parts[-2:] if len(parts) > 1 and parts[-2][:1].isupper() else parts[-1:]
    found = {
        name: entry
        for name, entry in domain.objects.items()
        if name.split(".")[-len(wanted) :] == wanted and not entry.aliased and entry.objtype != "attribute"
    }
    if len(found) > 1 and node.get("py:class"):
        # A bare `method` in the docstring of a class: its own, else the nearest base's.
        owner = pkgutil.resolve_name(f"{node['py:module']}:{node['py:class']}")
        near = (name for base in owner.__mro__ for name in found if name.endswith(f".{base.__name__}.{wanted[-1]}"))
        found = {name: found[name] for name in itertools.islice(near, 1)}
    if len(found) != 1:
        return None
    ((name, entry),) = found.items()
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, contnode, name)


def _math(block: bool) -> tuple[Any, None]:
    """Formulas as MathML, which browsers draw themselves: nothing is fetched to read a page."""

    def visit(writer: Any, node: nodes.Element) -> None:
        markup = latex2mathml.tex2mathml(node.astext(), as_block=block)
        writer.body.append(f'<div class="math">{markup}</div>' if block else markup)
        raise nodes.SkipNode

    return visit, None


def _escape(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Shapes like (*batch, p) and norms like |J| are text: no emphasis, no substitution."""
    for index, line in enumerate(lines):
        parts = re.split(r"(``.*?``|:\w[\w:]*:`[^`]*`|`[^`]*`)", line)
        parts[::2] = [re.sub(r"\*(?=\w)|\|", r"\\\g<0>", part) for part in parts[::2]]
        lines[index] = "".join(parts)


def _google(app: Sphinx, what: str, *rest: Any) -> None:
    """Napoleon takes what stands before a colon in a property's first line for its type; ours are sentences."""
    napoleon._process_docstring(app, "method" if what in ("property", "attribute", "data") else what, *rest)


def _tidy(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Defaults that are no Python, and the arguments of protocols, which nobody calls."""
    if signature == "(*args, **kwargs)":
        return "", returned
    if signature:
        signature = (
            re.sub(r"~(collections\.abc|typing|pathlib)\.", "", signature)
            .replace("<factory>", "...")
            .replace("PosixPath(", "Path(")
        )
    return signature, returned


def _scene(app: Sphinx, problem: Exception | None) -> None:
    """Writes the scene that the page of the viewer shows."""
    if problem is not None or app.builder.name != "html":
        return
    bk = importlib.import_module("bodyimage_kin")
    scene = bk.view.open_scene("infant")
    bk.view.export(scene, Path(app.outdir) / "_static" / "scene.html", "touch", "least_squares")


def setup(app: Sphinx) -> None:
    """Registers what is above."""
    app.connect("build-finished", _scene)
    app.add_html_math_renderer("mathml", inline_renderers=_math(False), block_renderers=_math(True))
    event = "autodoc-process-docstring"
    for listener in list(app.events.listeners[event]):
        if listener.handler is napoleon._process_docstring:
            app.disconnect(listener.id)
    app.connect(event, _escape, priority=400)
    app.connect(event, _google)
    app.connect("autodoc-process-signature", _tidy)
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Fields"
    app.connect("missing-reference", _resolve)

"""A name for the value of an object: settings, data and the code of its functions with all that they use."""

from __future__ import annotations

import dis
import functools
import hashlib
import importlib
import importlib.metadata
import importlib.util
import io
import sys
import sysconfig
import types
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from joblib.hashing import NumpyHasher

from sksurrogate.exceptions import DataError

#: Entries of a class that say nothing of what it does.
_SILENT = frozenset(
    {"__dict__", "__weakref__", "__doc__", "__module__", "__annotations__", "__dataclass_fields__", "_abc_impl"}
)
_GLOBAL = ("LOAD_GLOBAL", "LOAD_NAME")
#: Packages whose wrappers do what the function does that they wrap.
_WRAPPERS = ("functools", "numba", "jax", "jaxlib")


def fingerprint(value: Any, name: str, whole: bool = False) -> str:
    """Digest of a value, equal in another process, different where what the object does may differ.

    Functions and classes of installed packages count by name and version. All others count by what they are made of:
    code, defaults, closures, and the globals, modules and classes that the code names; what is compiled counts by its file. Not seen are
    files that the object reads, programs that it calls, and names that it makes up while it runs.

    ``name``: how a message calls it.
    ``whole``: also with what objects of one's own leave out of a pickle (``__getstate__``): a fork has it.
    Raises DataError where some part has no value: an open file, a lock, a connection.

    >>> from sksurrogate._fingerprint import fingerprint
    >>> slow, quick = (lambda x, k=k: k * x for k in (1.0, 2.0))
    >>> fingerprint(slow, "slow") == fingerprint(quick, "quick")
    False
    """
    try:
        return str((_WholeHasher if whole else _Hasher)().hash(value))
    except Exception as error:  # a pickle fails in whatever way the object chooses
        raise DataError(
            f"{name} cannot be distinguished from another one by its value ({type(error).__name__}: {str(error)[:200]}), so that what is "
            "kept on disk could be that of another: keep nothing, or give its class a __getstate__ that returns its settings "
            "without open files, locks and connections."
        ) from error


def is_open(thing: Any) -> bool:
    """Whether it is an open file, port or connection: some can be pickled, and go on with the same number elsewhere.

    >>> import io, socket
    >>> with socket.socket() as line:
    ...     is_open(line), is_open(io.BytesIO())
    (True, False)
    """
    return callable(getattr(type(thing), "fileno", None)) and not isinstance(thing, (io.BytesIO, io.StringIO))


@functools.cache
def _library() -> tuple[Path, ...]:
    """Folders of installed packages and of the standard library."""
    paths = sysconfig.get_paths()
    return tuple(Path(paths[key]).resolve() for key in ("stdlib", "platstdlib", "purelib", "platlib"))


@functools.cache
def _installed(module: str) -> bool:
    """Whether a module belongs to Python or to an installed package, which have a version."""
    top = module.partition(".")[0]
    if _of_python(top) or top == "sksurrogate":
        return True
    try:
        found = sys.modules.get(top) or importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return False
    spec = found if hasattr(found, "origin") else getattr(found, "__spec__", None)
    places = (
        [spec.origin] if spec is not None and spec.origin else list(getattr(spec, "submodule_search_locations", []))
    )
    return any(Path(str(place)).resolve().is_relative_to(folder) for place in places for folder in _library())


def _of_python(top: str) -> bool:
    return top in sys.builtin_module_names or top in sys.stdlib_module_names


_distributions = functools.cache(importlib.metadata.packages_distributions)


def _version(module: str) -> str:
    """As the package says it, else as it was installed."""
    top = module.partition(".")[0]
    said = getattr(sys.modules.get(top), "__version__", None)
    if said is not None or _of_python(top):
        return str(said or "")
    return " ".join(f"{one} {importlib.metadata.version(one)}" for one in sorted(set(_distributions().get(top, ()))))


def _content(module: str) -> str:
    """Digest of the file that a module was read from: what is written in C, say, has no other value."""
    source = getattr(sys.modules.get(module), "__file__", None)
    return hashlib.sha256(Path(source).read_bytes()).hexdigest() if source else ""


def _stands_there(thing: Any) -> bool:
    """Whether a function or class is what its module has under its name, and the module is installed."""
    module, found = getattr(thing, "__module__", None), sys.modules.get(getattr(thing, "__module__", None) or "")
    if module is None or found is None or not _installed(module):
        return False
    for part in thing.__qualname__.split("."):
        found = getattr(found, part, None)
    return found is thing


def _has_source(thing: type) -> bool:
    """Whether a class was made by Python code, which is one of its parts."""
    return str(getattr(sys.modules.get(thing.__module__), "__file__", ".py")).endswith((".py", ".pyc"))


def _codes(code: types.CodeType) -> Iterable[types.CodeType]:
    """The code and all that is defined inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _code(code: types.CodeType) -> tuple[Any, ...]:
    """What code does, without where it stands."""
    constants = tuple(_code(c) if isinstance(c, types.CodeType) else c for c in code.co_consts)
    counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return ("code", code.co_code, constants, counts, names, code.co_exceptiontable)


def _function(function: types.FunctionType) -> dict[str, Any]:
    """What a function is made of."""
    names: set[str] = set()
    imported: set[str] = set()
    used: set[str] = set()
    package = function.__globals__.get("__package__") or ""
    for code in _codes(function.__code__):
        used.update(code.co_names)
        steps = list(dis.get_instructions(code))
        for k, step in enumerate(steps):
            if step.opname in _GLOBAL:
                names.add(step.argval)
            elif step.opname == "IMPORT_NAME":
                level = steps[k - 2].argval if k > 1 and isinstance(steps[k - 2].argval, int) else 0
                imported.add("." * level + step.argval)
    cells = [cell.cell_contents for cell in function.__closure__ or () if _full(cell)]
    seen = {name: function.__globals__[name] for name in sorted(names) if name in function.__globals__}
    seen.update({f"import {name}": _import(name, package) for name in sorted(imported)})
    return {
        "code": _code(function.__code__),
        "defaults": (function.__defaults__, function.__kwdefaults__),
        "closure": [_of_module(cell, used) for cell in cells],
        "globals": {name: _of_module(value, used) for name, value in seen.items()},
        "attributes": {k: v for k, v in vars(function).items() if k != "__wrapped__"},
    }


def _full(cell: types.CellType) -> bool:
    try:
        return cell.cell_contents is not cell
    except ValueError:  # a name that is not bound yet
        return False


def _import(name: str, package: str) -> Any:
    """A module that a function imports while it runs; those of a package are not loaded for it."""
    try:
        whole = importlib.util.resolve_name(name, package)
        return whole if _installed(whole) else importlib.import_module(whole)
    except (ImportError, ValueError):
        return name


def _of_module(value: Any, used: set[str], above: tuple[int, ...] = ()) -> Any:
    """Of a user's module what a function may read of it; any other value as it is."""
    if not isinstance(value, types.ModuleType) or _installed(value.__name__):
        return value
    if id(value) in above:
        return ("module", value.__name__)
    here = (*above, id(value))
    read = {name: _of_module(vars(value)[name], used, here) for name in sorted(used) if name in vars(value)}
    return ("module", value.__name__, read)


class _Hasher(NumpyHasher):
    """joblib's digest of a pickle, by value where joblib goes by name."""

    def save(self, obj: Any) -> None:
        if isinstance(obj, types.MethodType):
            obj = ("method", obj.__func__, obj.__self__)
        elif isinstance(obj, types.BuiltinFunctionType) and not _installed(obj.__module__ or "builtins"):
            obj = ("compiled", obj.__module__, obj.__qualname__, _content(obj.__module__))
        elif isinstance(obj, (set, frozenset)):
            obj = (type(obj).__name__, sorted(str(type(self)().hash(part)) for part in obj))
        elif isinstance(obj, np.ndarray) and type(obj) not in (np.ndarray, np.memmap):  # with a mask, or a unit
            obj = (type(obj), np.array(obj, subok=False), obj.__reduce__()[2])
        super().save(obj)

    def save_global(self, obj: Any, *name: Any) -> None:
        super().save_global(obj, *name)
        module = getattr(obj, "__module__", None) or ""
        if module and not _installed(module):
            self.save(_content(module))

    def memoize(self, obj: Any) -> None:
        # whether two equal tuples are one object depends on whether a module was compiled or read from __pycache__
        if not isinstance(obj, tuple):
            super().memoize(obj)

    def _batch_setitems(self, items: Any, *more: Any) -> None:
        pairs = list(items)
        if all(type(key) is str for key, _ in pairs):
            pairs.sort(key=lambda pair: pair[0])
        else:
            pairs.sort(key=lambda pair: str(type(self)().hash(pair[0])))
        for key, value in pairs:
            self.save(key)
            self.save(value)
        self.write(b"u")

    def reducer_override(self, obj: Any) -> Any:
        """Parts of what a pickle would only name; ``tuple`` builds nothing, since nobody reads the pickle."""
        if isinstance(obj, types.ModuleType):
            if _installed(obj.__name__):
                return tuple, (("installed", obj.__name__, _version(obj.__name__)),)
            parts = {name: value for name, value in vars(obj).items() if not name.startswith("__")}
            return tuple, (("module", obj.__name__, _content(obj.__name__)),), parts
        if isinstance(obj, (types.FunctionType, type)):
            return self._named(obj)
        if isinstance(obj, property):
            return tuple, (("property", obj.fget, obj.fset, obj.fdel),)
        if isinstance(obj, (staticmethod, classmethod)):
            return tuple, ((type(obj).__name__, obj.__func__),)
        if isinstance(obj, functools.cached_property):
            return tuple, (("cached", obj.func),)
        if isinstance(obj, types.MappingProxyType):
            return tuple, (("mapping", dict(obj)),)
        if isinstance(obj, (types.GetSetDescriptorType, types.MemberDescriptorType)):
            return tuple, (("slot", obj.__name__),)
        if is_open(obj):
            raise TypeError(f"{type(obj).__name__} is an open file or connection")  # some can be pickled: a serial port
        for inner in ("__wrapped__", "py_func"):  # of functools.cache, jax, numba
            function = getattr(obj, inner, None)
            if isinstance(function, types.FunctionType) and type(obj).__module__.partition(".")[0] in _WRAPPERS:
                return tuple, (("wrapped", type(obj).__qualname__, function),)
        if callable(getattr(type(obj), "_files", None)):
            read = obj.__reduce_ex__(4)
            return (
                tuple,
                ((read[1], [hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in obj._files()]),),
                read[2],
            )
        return NotImplemented

    def _named(self, obj: Any) -> Any:
        """A function or class: by name where it is installed, else by its parts."""
        if getattr(obj, "__module__", None) == "builtins":
            return NotImplemented
        if _stands_there(obj):
            return tuple, (("installed", obj.__module__, obj.__qualname__, _version(obj.__module__)),)
        if isinstance(obj, types.FunctionType):
            return tuple, (("function",),), _function(obj)
        parts = {k: v for k, v in vars(obj).items() if k not in _SILENT}
        compiled = "" if _has_source(obj) else _content(obj.__module__)
        return tuple, (("class", obj.__qualname__, type(obj), compiled),), {"bases": obj.__bases__, "parts": parts}


class _WholeHasher(_Hasher):
    """With what a pickle of an object would leave out."""

    def reducer_override(self, obj: Any) -> Any:
        if hasattr(obj, "__dict__") and not isinstance(obj, type) and _leaves_out(type(obj)):
            return tuple, (("object", type(obj)),), vars(obj)
        return super().reducer_override(obj)


def _leaves_out(kind: type) -> bool:
    """Whether a class of one's own says itself what a pickle takes."""
    own = [one for one in kind.__mro__ if not _installed(one.__module__)]
    return any(name in vars(one) for one in own for name in ("__getstate__", "__reduce__", "__reduce_ex__"))

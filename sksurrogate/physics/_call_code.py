"""Machine code of a loop over calls to C functions, by llvmlite."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache


@lru_cache(maxsize=64)
def machine_code(shape: tuple[tuple[str, bool], ...]) -> Callable[[int, int, int], int] | None:
    """The loop over calls of these kinds of arguments, ``(table, first, end) -> point``; None without llvmlite.

    The table, 64 bits an entry, holds the status of the call that fails, then of every call the address of the function, that of the
    bytes that tell where it is left out, and its arguments.

    ``shape``: of every call the kinds of its arguments, and whether it is left out at some points. Kinds are "i", an integer, and "r" and
        "d", two entries: the address of an array and the width of its rows, of which the address is passed, or the number there.
    """
    try:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        machine = llvm.Target.from_default_triple().create_target_machine(opt=2, jit=True)
        module = llvm.parse_assembly(_assembly(shape))
        module.verify()
        engine = llvm.create_mcjit_compiler(module, machine)
        engine.finalize_object()
        whole = ctypes.c_int64
        compiled = ctypes.CFUNCTYPE(whole, whole, whole, whole)(engine.get_function_address("walk"))
    except (
        ImportError,
        OSError,
        RuntimeError,
    ):  # not installed, or a machine that lets no code be made: ctypes does the same
        return None
    compiled.engine = engine  # type: ignore[attr-defined]
    return compiled


class _Table:
    """Entries of the table, read before the loop begins."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._place = 1  # behind the status

    def entry(self, name: str, kind: str = "i64") -> str:
        """The next one."""
        self.lines += [
            f"  %{name}.at = getelementptr i64, ptr %table, i64 {self._place}",
            f"  %{name} = load {kind}, ptr %{name}.at",
        ]
        self._place += 1
        return f"%{name}"


def _assembly(shape: tuple[tuple[str, bool], ...]) -> str:
    """The loop in LLVM's language."""
    table, n_calls = _Table(), len(shape)
    body = [line for c, (kinds, some) in enumerate(shape) for line in _call(c, kinds, some, table)]
    failed = [f"[%s{c}, %{'do' if some else 'call'}{c}]" for c, (_, some) in enumerate(shape)]
    lines = [
        "define i64 @walk(i64 %given, i64 %first, i64 %end) {",
        "begin:",
        "  %table = inttoptr i64 %given to ptr",
        *table.lines,
        "  br label %head",
        "head:",
        f"  %k = phi i64 [%first, %begin], [%next, %call{n_calls}]",
        "  %more = icmp slt i64 %k, %end",
        "  br i1 %more, label %call0, label %all",
        *body,
        f"call{n_calls}:",
        "  %next = add i64 %k, 1",
        "  br label %head",
        "failed:",
        f"  %status = phi i32 {', '.join(failed)}",
        "  %wide = zext i32 %status to i64",
        "  store i64 %wide, ptr %table",
        "  ret i64 %k",
        "all:",
        "  ret i64 %end",
        "}",
    ]
    return "\n".join(lines)


def _call(c: int, kinds: str, some: bool, table: _Table) -> list[str]:
    """One call at point k."""
    function, lines, given = table.entry(f"f{c}", "ptr"), [f"call{c}:"], []
    if some:
        lines += [
            f"  %w{c}.this = getelementptr i8, ptr {table.entry(f'w{c}', 'ptr')}, i64 %k",
            f"  %w{c}.go = load i8, ptr %w{c}.this",
            f"  %w{c}.is = icmp ne i8 %w{c}.go, 0",
            f"  br i1 %w{c}.is, label %do{c}, label %call{c + 1}",
            f"do{c}:",
        ]
    for a, kind in enumerate(kinds):
        name = f"a{c}.{a}"
        if kind == "i":
            given.append(f"i64 {table.entry(name)}")
            continue
        start, width = table.entry(name, "ptr"), table.entry(f"{name}.width")
        lines += [
            f"  %{name}.far = mul i64 %k, {width}",
            f"  %{name}.now = getelementptr i8, ptr {start}, i64 %{name}.far",
        ]
        if kind == "d":
            lines.append(f"  %{name}.real = load double, ptr %{name}.now")
        given.append(f"double %{name}.real" if kind == "d" else f"ptr %{name}.now")
    return [
        *lines,
        f"  %s{c} = call i32 {function}({', '.join(given)})",
        f"  %s{c}.bad = icmp ugt i32 %s{c}, 1",
        f"  br i1 %s{c}.bad, label %failed, label %call{c + 1}",
    ]

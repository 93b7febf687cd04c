"""Every kernel compiles for CUDA, on machines without a GPU too: Warp's wheel contains NVIDIA's compiler.

Compiling says nothing about results or speed on a GPU. mujoco_warp's own kernels are not compiled here.
"""

import ast
import importlib
import tempfile
from pathlib import Path

import pytest
import warp as wp

import spin_rl
from tests.conftest import NUM_WORLDS

ARCH = 90  # PTX for compute capability 9.0
ROOT = Path(spin_rl.__file__).parent


def _is_kernel(node: ast.AST) -> bool:
    """Whether an expression is `wp.kernel`, `warp.kernel` or a call of it."""
    node = node.func if isinstance(node, ast.Call) else node
    return isinstance(node, ast.Attribute) and node.attr == "kernel"


def kernel_names(source: str) -> set[str]:
    """Qualified names of the kernels that a file defines, at its top level and inside functions."""
    names = set()

    def visit(node: ast.AST, outer: str) -> None:
        inner = outer
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            if any(map(_is_kernel, node.decorator_list)):
                names.add(outer + node.name)
            inner = f"{outer}{node.name}." + ("<locals>." if isinstance(node, ast.FunctionDef) else "")
        # Without a decorator the name is not known: no compiled kernel has this one, and the test says so.
        if isinstance(node, ast.Call) and _is_kernel(node) and node.args:
            names.add(f"{outer}<wp.kernel called in line {node.lineno}>")
        for child in ast.iter_child_nodes(node):
            visit(child, inner)

    visit(ast.parse(source), "")
    return names


def kernels_of(module: str) -> dict[str, list[wp.Kernel]]:
    """Kernels that exist now and come from a Python module, by qualified name.

    A file's kernels are usually in a Warp module of the same name; those with `module="unique"` are not.
    """
    found = {}
    for owner in wp._src.context.user_modules.values():
        for kernel in owner._get_live_kernels():
            if kernel.func.__module__ == module and not (kernel.is_generic and not kernel.overloads):
                found.setdefault(kernel.func.__qualname__, []).append(kernel)
    return found


def compile_for_cuda(module: wp.Module) -> str:
    """Compile a Warp module in a temporary folder and return the PTX."""
    with tempfile.TemporaryDirectory() as folder:
        # Warp builds in a sibling of the folder that it is given.
        [ptx] = wp.compile_aot_module(module, arch=[ARCH], module_dir=Path(folder, "module"), use_ptx=True)
        assert ptx.is_relative_to(folder)
        return ptx.read_text()


FILES = [path for path in sorted(ROOT.rglob("*.py")) if kernel_names(path.read_text())]


@pytest.fixture(autouse=True)
def _compiler():
    if ARCH not in wp.get_cuda_supported_archs():
        pytest.skip("this build of Warp has no CUDA compiler")


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_compiles(path):
    name = ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
    importlib.import_module(name)
    kernels = kernels_of(name)
    missing = kernel_names(path.read_text()) - kernels.keys()
    # Kernels that a function makes exist once it was called: call it when the file is imported, or here.
    assert not missing, f"{name}: never made, and so not compiled: {sorted(missing)}"
    for module in {kernel.module for made in kernels.values() for kernel in made}:
        ptx = compile_for_cuda(module)
        assert f".target sm_{ARCH}" in ptx
        for kernel in module._get_live_kernels():
            assert f"{kernel.get_mangled_name()}_cuda_kernel_forward" in ptx


def test_finds_the_files():
    assert len(FILES) > 20


def test_finds_kernels_made_by_functions():
    source = """
@wp.kernel
def plain(): ...
def make(count):
    @wp.kernel(enable_backward=False)
    def made(): ...
    return made, wp.kernel(other)
"""
    assert kernel_names(source) == {
        "plain",
        "make.<locals>.made",
        "make.<locals>.<wp.kernel called in line 7>",
    }


@wp.func_native("""
#if defined(__CUDA_ARCH__)
value.data[index] = no_such_function(1.0f);
#endif
""")
def _broken_on_cuda(value: wp.array[float], index: int): ...


def _make_broken():
    @wp.kernel(module="unique")
    def broken(value: wp.array[float]):
        _broken_on_cuda(value, wp.tid())

    return broken


def test_notices_what_only_cuda_refuses(capfd):
    broken = _make_broken()
    value = wp.zeros(NUM_WORLDS, dtype=float, device="cpu")
    wp.launch(broken, dim=NUM_WORLDS, inputs=[value], device="cpu")
    assert _make_broken.__name__ + ".<locals>.broken" in kernels_of(__name__)
    with pytest.raises(Exception, match="CUDA"):
        compile_for_cuda(broken.module)
    assert "no_such_function" in "".join(capfd.readouterr())

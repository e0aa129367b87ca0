"""Exported C on a Cortex-M4: cross-compiled, run by an emulator, the same outputs.

``pytest -rA tests/export/test_cortex_m4.py`` prints the instructions of one sample: the mean
with its call and the loop round it.
"""

import shutil
import subprocess

import native
import numpy as np
import pytest

import dryfric_control as dfc

GCC, QEMU = "arm-none-eabi-gcc", "qemu-system-arm"
missing = [tool for tool in (GCC, QEMU) if shutil.which(tool) is None]
pytestmark = pytest.mark.skipif(bool(missing), reason=f"no {', '.join(missing)}")

N = 200  # samples
AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.3, 2e-3),
    effects=(dfc.effects.BiasForce(1.0), dfc.effects.InputDelay(2e-3)), name="stage",
)  # fmt: skip
U = native.random_drive(np.random.default_rng(7), N)
Y = native.reading(AXIS, U)

LINKER = """
MEMORY { ROM (rx) : ORIGIN = 0, LENGTH = 4M  RAM (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
ENTRY(reset)
SECTIONS {
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) *(.init) *(.fini) } > ROM
    .exidx : { *(.ARM.exidx*) } > ROM
    .data : { *(.data*) . = ALIGN(8); } > RAM
    .bss : { __bss_start__ = .; *(.bss*) *(COMMON) . = ALIGN(8); __bss_end__ = .; } > RAM
    end = .; __end__ = .;
    __stack = ORIGIN(RAM) + LENGTH(RAM);
}
"""


def board(made, inputs) -> str:
    """A program that steps through the inputs, and prints outputs and instructions."""
    n, real = made.name, f"{made.name}_real"
    rows = ",\n".join(", ".join(float(v).hex() for v in row) for row in np.column_stack(inputs))
    starts = "".join(", 0" for _ in made.starts)
    given = "".join(f", in[k][{i}]" for i in range(len(inputs)))
    words = "\n".join(
        f"        out[k][{i}] = ({real})o.{s.name};" for i, s in enumerate(made.outputs)
    )
    return f"""#include "{n}.h"
#include <stdint.h>
extern uint32_t __stack[];
int main(void);
void reset(void);
__attribute__((section(".vectors"), used)) static void *const vectors[2] = {{__stack, (void *)reset}};
static const {real} in[{N}][{len(inputs)}] = {{ {rows} }};
static {real} out[{N}][{len(made.outputs)}];
static {n}_state state;
static void call(int what, const void *with)
{{
    register int r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = with;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}}
static void print(uint32_t word)
{{
    char text[10];
    for (int i = 0; i < 8; ++i)
        text[i] = "0123456789abcdef"[(word >> (28 - 4 * i)) & 15u];
    text[8] = '\\n';
    text[9] = 0;
    call(4, text);
}}
void reset(void)
{{
    volatile uint32_t *const control = (uint32_t *)0xE000E010; /* SysTick */
    {n}_output o;
    uint32_t turned, sum, most = 0;
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* the floating-point unit */
    __asm__ volatile("dsb; isb");
    control[1] = 0xffffffu;
    control[2] = 0;
    control[0] = 5;
    __asm__ volatile("ldr r3, =100000\\n1: subs r3, r3, #1\\n bne 1b" ::: "r3", "cc");
    turned = 0xffffffu - control[2]; /* 200 000 instructions */
    {n}_init(&state{starts});
    for (int k = 0; k < {N}; ++k) {{
        uint32_t spent;
        control[2] = 0;
        control[0] = 5;
        (void){n}_step(&state{given}, &o);
        spent = 0xffffffu - control[2];
        control[0] = 0;
        most = spent > most ? spent : most;
{words}
    }}
    {n}_init(&state{starts});
    control[2] = 0;
    control[0] = 5;
    for (int k = 0; k < {N}; ++k)
        (void){n}_step(&state{given}, &o);
    sum = 0xffffffu - control[2];
    control[0] = 0;
    print(sum);
    print(most);
    print(turned);
    for (unsigned i = 0; i < sizeof out / 4; ++i)
        print(((const uint32_t *)out)[i]);
    call(0x18, (void *)0x20026);
    for (;;) {{ }}
}}
"""


def on_board(obj, folder, inputs, precision="double"):
    """Outputs of the emulated board, and the mean and largest number of instructions."""
    code = native.Native(obj, folder, precision)
    (folder / "board.c").write_text(board(code.made, inputs))
    (folder / "board.ld").write_text(LINKER)
    program = str(folder / "board.elf")
    subprocess.run([
        GCC, "-std=c99", "-O2", "-ffp-contract=off", "-mcpu=cortex-m4", "-mthumb",
        "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-fno-strict-aliasing", "-nostartfiles",
        "-T", str(folder / "board.ld"), str(code.files[1]), str(folder / "board.c"),
        "-o", program, "-lm", "-lc", "-lgcc", "--specs=nosys.specs",
    ], check=True)  # fmt: skip
    done = subprocess.run([
        QEMU, "-M", "mps2-an386", "-cpu", "cortex-m4", "-nographic", "-monitor", "none",
        "-serial", "none", "-icount", "shift=0", "-semihosting-config",
        "enable=on,target=native", "-kernel", program,
    ], capture_output=True, timeout=120, check=True)  # fmt: skip
    words = np.array([int(w, 16) for w in (done.stdout + done.stderr).split()], dtype=np.uint32)
    out = words[3:].view(code.inner).reshape(N, -1).T.astype(float)
    tick = 200_000 / int(words[2])
    mean, most = tick * int(words[0]) / N, tick * int(words[1])
    print(f"{code.made.kind}, {precision}: {mean:.0f} instructions a sample, {most:.0f} at most")
    return out, code


def test_the_observer_is_the_same_on_a_cortex_m4(tmp_path):
    design = dfc.design_pi_observer(AXIS, dt=1e-3, encoder_quantum=1e-6)
    out, _ = on_board(design, tmp_path, (U, Y))
    # It calls nothing of the mathematical library.
    assert native.ulps(out, native.by_kernel(design, U, Y)) == 0
    out, code = on_board(design, tmp_path, (U, Y), "single")
    assert np.array_equal(out, code.run(U, Y)[0])
    mixed, _ = on_board(design, tmp_path, (U, Y), "mixed")
    np.testing.assert_allclose(mixed, out, rtol=1e-6, atol=1e-9)  # the same readings


@pytest.mark.slow
def test_the_filter_and_the_compensation_are_the_same_but_for_the_library(tmp_path):
    move = dfc.motion_profile(
        [0.0, 2e-3, 0.0], 1e-3, velocity=0.05, acceleration=1.0, jerk=50.0, dwell=0.05
    ).rows[:, :N]
    for make, inputs in ((dfc.hybrid_filter, (U, Y)), (dfc.design_compensation, (*move, move[0]))):
        made = make(AXIS, 1e-3, encoder_quantum=1e-6)
        out, _ = on_board(made, tmp_path / make.__name__, inputs)
        expected = native.by_kernel(made, *inputs)
        np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-9)


def test_the_axis_is_the_same_but_for_the_library(tmp_path):
    out, _ = on_board(AXIS, tmp_path, (U,))
    np.testing.assert_allclose(out, AXIS.simulate(U, 1e-3).y, rtol=1e-9, atol=1e-9)

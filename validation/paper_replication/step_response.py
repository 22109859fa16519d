r"""Fig. 3: step response of the mathematical model.

Eqs. (1)-(6) with $B_{vk} = 49.849$ N/(m/s) under the continuous PID ($k_p = 20.39$, $k_i = 56.57$, $k_d = 1.34$,
$N = 327$), from rest, the reference of the tilt stepped to 57.3° = 1 rad. Integrated by RK4 at 0.2 ms from
`PlanarModel.accelerations`; checked against the equations written out once more, and the linear case against its
modes. The printed overshoot and settling time (2 %) match neither the nonlinear equations nor their linearization; the
linearized model gives them at $B_{vk} = 7$, which may be a coincidence. The derivative's kick, $(k_p + k_d N) \cdot 1$
rad = 459 N·m of virtual torque in the first instant, is what makes the response that fast; no contact could transmit
it.

Sampled, as any controller of a simulated robot is, the same PID on `Ballbot(model="planar")` answers with less
overshoot and more slowly up to 2 ms, and loses its damping above.
"""

from typing import TYPE_CHECKING

import numpy as np

from validation.claim import Claim
from validation.page import table
from validation.paper_replication import response
from validation.paper_replication.response import VISCOUS_FRICTION, Analysis, analyze
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PRINTED = Analysis(overshoot=0.18, settling=0.397)
#: The viscous friction at which the linearized model answers as printed.
_OTHER_FRICTION = 7.0
_DT = 2e-4
_SAMPLING = (1e-5, 1e-4, 1e-3, 2e-3, 5e-3, 1e-2)


def run() -> Findings:
    """Integrates all variants."""
    rest = np.zeros(6)
    plants = {
        f"nonlinear, B_vk = {VISCOUS_FRICTION:g}": response.model_plant(VISCOUS_FRICTION),
        f"linearized, B_vk = {VISCOUS_FRICTION:g}": response.linear_plant(VISCOUS_FRICTION),
        f"nonlinear, B_vk = {_OTHER_FRICTION:g}": response.model_plant(_OTHER_FRICTION),
        f"linearized, B_vk = {_OTHER_FRICTION:g}": response.linear_plant(_OTHER_FRICTION),
        f"nonlinear, three wheels, B_vk = {VISCOUS_FRICTION:g}": response.model_plant(VISCOUS_FRICTION, "three_wheels"),
    }
    runs = {name: response.closed_loop(plant, 1.0, rest, 1.0, _DT) for name, plant in plants.items()}
    found = {name: analyze(rows[:, 1], _DT) for name, rows in runs.items()}
    sampled = {dt: response.sampled_step(dt) for dt in _SAMPLING}
    nonlinear, linearized, _, other, three_wheels = list(runs)

    written = response.closed_loop(response.written_out(VISCOUS_FRICTION), 1.0, rest, 1.0, _DT)
    fine = analyze(
        response.closed_loop(response.written_out(VISCOUS_FRICTION), 1.0, rest, 0.5, 0.5 * _DT)[:, 1], 0.5 * _DT
    )
    times = np.array([k * _DT for k in range(len(written))])
    modes = {name: response.linear_tilt(b, times) for name, b in ((linearized, VISCOUS_FRICTION), (other, 7.0))}
    claims = [
        Claim(
            "nonlinear: largest difference of tilt from the equations written out",
            float(np.abs(runs[nonlinear][:, 1] - written[:, 1]).max()),
            0.0,
            1e-13,
            "rad",
            absolute=True,
        ),
        Claim("nonlinear: overshoot, against half the step", found[nonlinear].overshoot, fine.overshoot, 1e-5),
        Claim("nonlinear: settling time, against half the step", found[nonlinear].settling, fine.settling, 1e-3, "s"),
    ]
    for name, tilt in modes.items():
        exact = analyze(tilt, _DT)
        claims.append(Claim(f"{name}: overshoot, against the modes", found[name].overshoot, exact.overshoot, 2e-9))
        claims.append(
            Claim(f"{name}: settling time, against the modes", found[name].settling, exact.settling, 1e-3, "s")
        )
    finest = analyze(sampled[_SAMPLING[0]][:, 1], _SAMPLING[0])
    continuous = found[three_wheels]
    claims.append(
        Claim(
            "`planar` and `Pid` at 100 kHz: overshoot, against continuous", finest.overshoot, continuous.overshoot, 2e-3
        )
    )
    claims.append(
        Claim(
            "`planar` and `Pid` at 100 kHz: settling, against continuous",
            finest.settling,
            continuous.settling,
            2e-3,
            "s",
        )
    )

    rows = [["printed", f"{100 * PRINTED.overshoot:.0f}", f"{PRINTED.settling:.3f}"]]
    rows += [[name, f"{100 * a.overshoot:.1f}", f"{a.settling:.3f}"] for name, a in found.items()]
    for dt, x in sampled.items():
        a = analyze(x[:, 1], dt)
        settling = f"{a.settling:.3f}" if a.settling < 0.99 else "not within 1 s"
        rows.append([f"`planar` and `Pid`, every {1e3 * dt:g} ms", f"{100 * a.overshoot:.1f}", settling])
    a, b, c = found[nonlinear], found[linearized], found[other]
    compared = Comparison(
        "overshoot, settling time (2 %) of a 57.3° step",
        "Section III-A, Fig. 3",
        "18 %, 0.397 s",
        f"nonlinear {100 * a.overshoot:.1f} %, {a.settling:.2f} s; "
        f"linearized {100 * b.overshoot:.1f} %, {b.settling:.2f} s",
        "unknown: eqs. (1)-(6) with the printed gains do not give it; "
        f"linearized at B_vk = {_OTHER_FRICTION:g} they give {100 * c.overshoot:.1f} %, {c.settling:.3f} s",
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS, INK

        axes = fig.subplots(2, 2, sharex=True).ravel()
        shown = {
            nonlinear: (runs[nonlinear], _DT, COLORS[0]),
            linearized: (runs[linearized], _DT, COLORS[1]),
            other: (runs[other], _DT, COLORS[3]),
            "`planar` and `Pid` at 1 kHz".replace("`", ""): (sampled[1e-3], 1e-3, COLORS[2]),
        }
        labels = ("tilt (deg)", "tilt rate (deg/s)", "ball position y (m)", "ball speed (m/s)")
        for name, (x, dt, color) in shown.items():
            keep = slice(None, None, max(round(2e-3 / dt), 1))
            t = np.arange(len(x))[keep] * dt
            for ax, column, scale in zip(axes, (1, 3, 0, 2), (np.degrees(1.0), np.degrees(1.0), 1.0, 1.0), strict=True):
                ax.plot(t, scale * x[keep, column], color=color, label=name)
        for ax, label in zip(axes, labels, strict=True):
            ax.set_ylabel(label)
        axes[0].axhline(np.degrees(1.0 + PRINTED.overshoot), color=INK, linestyle="--", linewidth=0.8)
        axes[0].axvline(PRINTED.settling, color=INK, linestyle="--", linewidth=0.8)
        axes[0].annotate("printed: 18 %, 0.397 s", (0.41, 0.08), xycoords=("data", "axes fraction"), fontsize=9)
        for ax in axes[2:]:
            ax.set_xlabel("time (s)")
        axes[2].legend(fontsize=8)

    head = ["", "overshoot (%)", "settling time (s)"]
    return Findings(claims, draw, table(head, rows), size=(8.0, 5.2), compared=(compared,))

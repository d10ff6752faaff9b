"""Truth cases written as case files, in the units and words of a case file."""

import numpy as np
from separation_cases import TRUTH_CASES


def truth_case_file(name, force_line):
    """The text of the case file of a truth case, by its name and "guided" or "strut"."""
    inputs, stowed = TRUTH_CASES[name]["inputs"], TRUTH_CASES[name]["results"][force_line]["stowed_length"]
    springs = inputs["springs"]
    lines = [f'name = "{name}"']
    for body in ("platform", "satellite"):
        lines += [
            f"[{body}]",
            f"mass = {inputs[body]['mass']!r}",
            f"inertia = {inputs[body]['inertia']!r}",
            f"center_of_mass = {(1e3 * np.array(inputs[body]['cg'])).tolist()!r}",
        ]
    lines += [
        "[springs]",
        f"angles = {np.degrees(springs['alpha']).tolist()!r}",
        f"radius = {1e3 * springs['R']!r}",
        f"stiffness = {springs['K']!r}",
        f"deformation = {(1e3 * np.array(springs['xi'])).tolist()!r}",
        f"stroke = {(1e3 * np.array(springs['L'])).tolist()!r}",
        f'force_line = "{force_line}"',
    ]
    if stowed:
        lines.append(f"stowed_length = {1e3 * stowed!r}")
    lines += [
        "[initial]",
        f"attitude = {inputs['attitude0']!r}",
        f"rates = {np.degrees(inputs['omega0']).tolist()!r}",
        f"velocity = {inputs['velocity0']!r}",
        'pivot = "platform"',
    ]
    gravity = inputs["gravity"]
    if gravity is not None:
        lines += [
            "[orbit]",
            f"position = {(1e-3 * np.array(gravity['r_eci'])).tolist()!r}",
            f"velocity = {(1e-3 * np.array(gravity['v_eci'])).tolist()!r}",
            f"gravitational_parameter = {1e-9 * gravity['mu']!r}",
            f"gradient_torque = {str(gravity['gradient']).lower()}",
        ]
    return "\n".join(lines) + "\n"

"""A ray through the surfaces of a .zmx file, by root finding and Snell's law as a vector: slow, and apart from saf_gen.

It knows spheres, conics and even aspheres, and glasses by index and Abbe number.
"""

import numpy as np
from scipy.optimize import brentq


def surfaces_of(text, *, wave_um):
    """A list of curvature, conic, powers of r² from the second on, thickness (mm) and index behind each surface."""
    found = []
    for block in text.split("SURF ")[2:-1]:
        rows = [line.split() for line in block.splitlines()[1:]]
        one = {words[0]: words[1:] for words in rows if words[0] != "PARM"}
        powers = {int(words[1]): float(words[2]) for words in rows if words[0] == "PARM"}
        index = 1.0
        if "GLAS" in one:
            n, v = (float(word) for word in one["GLAS"][3:5])
            b = (n - 1) / v / (0.4861327**-2 - 0.6562725**-2)  # n = a + b/λ²
            index = n + b * (wave_um**-2 - 0.5875618**-2)
        found.append(
            (float(one["CURV"][0]), float(one.get("CONI", ["0"])[0]), powers, float(one["DISZ"][0]), float(index))
        )
    return found


def traced(surfaces, place, way):
    """Place (mm) and slope behind the last surface, in the plane of its vertex, of a ray in the plane of the first."""
    p, d, index = np.array([*place, 0.0]), np.array([*way, 1.0]), 1.0
    d /= np.linalg.norm(d)
    for curvature, conic, powers, thickness, behind in surfaces:

        def sag(q, c=curvature, k=conic, powers=powers):
            s = q[0] ** 2 + q[1] ** 2
            return c * s / (1 + np.sqrt(1 - (1 + k) * c * c * s)) + sum(a * s**n for n, a in powers.items())

        p = p - p[2] / d[2] * d
        reach = min(0.6 / max(abs(curvature), 1e-3), 1.5 * np.hypot(*p[:2]) + 0.1)  # meets no sphere from behind
        p = p + brentq(lambda t, p=p, d=d: (p + t * d)[2] - sag(p + t * d), -reach, reach, xtol=1e-13) * d
        h = 1e-6
        slope = [(sag(p + h * e) - sag(p - h * e)) / (2 * h) for e in np.eye(3)[:2]]
        normal = np.array([-slope[0], -slope[1], 1.0])
        normal /= np.linalg.norm(normal)
        across = index / behind * (d - (d @ normal) * normal)
        d = across + np.sqrt(1 - across @ across) * normal
        p, index = p - np.array([0, 0, thickness]), behind
    p = p + np.array([0, 0, surfaces[-1][3]])  # back to the vertex of the last surface
    return p[:2] - p[2] * d[:2] / d[2], d[:2] / d[2]

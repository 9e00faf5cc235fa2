"""The yaw rate of a vehicle that its gyro leads: what gyro and model know of it together.

    e = ω_z − h(ν_ψ)  of the gyro, at the ν_ψ that the commands make                                      (1)
    S_e(f) = N (1 + ρ P_τ(f)),   P_τ of an Ornstein-Uhlenbeck process of variance 1                       (2)
    N, ρ, τ = arg min Σ_f log S_e + |ê|²/S_e   (Whittle)                                                  (3)
    s = F⁻¹ [ρ P_τ/(1 + ρ P_τ)] F e,   ω̂ = h(ν_ψ) + s,   dω̂/dt = dh/dt + ds/dt                            (4)

Why not ω_z itself: noise in a regressor draws what it multiplies towards 0 ("errors in variables"). The slope of a
gyro is mostly noise, a lever arm of 75 mm came out 16 mm short by it, and the speed is drawn down with it. (4) is
the mean of the true rate given all that was measured: what it errs by has nothing to do with it, and draws nothing
("regression calibration"). Where the model's yaw rate is right e is white, ρ = 0 and the model leads; where a real
steering has slack and slip e is slow and large, and the gyro leads as far as it is above its noise.
e is clipped at FAR standard deviations of its own. Of (2) ρ = 0 is among the choices, and left only for a gain of
GAIN in the log-likelihood (Akaike: one for each number more).
Sources: Carroll, Ruppert, Stefanski and Crainiceanu 2006 for the calibration; Whittle 1953; Wiener 1949.
"""

import numpy as np

from baqueano.identify.residuals.huber import MAD

RATIOS = np.geomspace(1.0 / 64.0, 1024.0, 33)  # ρ, and τ in ticks
LASTS = np.geomspace(0.5, 256.0, 19)
FAR = 6.0
GAIN = 2.0
FEWEST = 64  # rows of a piece, below which the gyro leads alone


def slow_part(e: np.ndarray) -> np.ndarray:
    """s (N,) of residuals e (N,) at steady ticks.  (2)-(4)"""
    n = len(e)
    if n < FEWEST:
        return e
    far = FAR * MAD * float(np.median(np.abs(e - np.median(e))))
    kept = np.clip(e, np.median(e) - far, np.median(e) + far)
    both = np.fft.rfft(np.concatenate([kept, kept[::-1]]))  # mirrored, so that its ends meet
    ratio = _ratio(np.abs(np.fft.rfft(kept - kept.mean()))[1:] ** 2 / n, n)
    if ratio is None:
        return np.zeros(n)
    power = ratio[0] * _shape(ratio[1], 2 * n)
    return np.asarray(np.fft.irfft(both * (power / (1.0 + power)), 2 * n)[:n])


def _ratio(periodogram: np.ndarray, n: int) -> tuple[float, float] | None:
    """ρ and τ of a periodogram without its mean; None where white noise says it as well.  (3)"""
    white = len(periodogram) * np.log(max(float(np.mean(periodogram)), 1e-300))
    best, found = white - GAIN, None
    for lasts in LASTS:
        relative = 1.0 + RATIOS[:, None] * _shape(float(lasts), n)[None, 1:]
        costs = np.sum(np.log(relative), axis=1)
        noise = np.mean(periodogram / relative, axis=1)
        costs = costs + len(periodogram) * np.log(np.maximum(noise, 1e-300))
        k = int(np.argmin(costs))
        if costs[k] < best:
            best, found = float(costs[k]), (float(RATIOS[k]), float(lasts))
    return found


def _shape(lasts: float, n: int) -> np.ndarray:
    """P_τ (n/2 + 1,) at the frequencies of a transform of n ticks, of a process that lasts `lasts` ticks.  (2)"""
    a = np.exp(-1.0 / lasts)
    return np.asarray(
        (1.0 - a * a) / (1.0 - 2.0 * a * np.cos(2.0 * np.pi * np.arange(n // 2 + 1) / n) + a * a)
    )

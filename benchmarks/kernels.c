/* The texts of kernels.py written by hand, as one who wants speed would: the structure of the matrices used,
   vectors where there are many derivatives or many vehicles. State x, y, ψ, ν_x, ν_y, ν_ψ. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define DT 0.01
#define EACH(i, n) for (int i = 0; i < (n); ++i)

typedef double v8 __attribute__((vector_size(64)));
typedef long long m8 __attribute__((vector_size(64)));

/* a: one trajectory; θ = d_l, d_c, T by rows, m, I */

static inline void right_hand_side(const double *x, const double *u, const double *p, double *d) {
    const double *dl = p, *dc = p + 3, *T = p + 6, m = p[15], I = p[16];
    double c = cos(x[2]), s = sin(x[2]), f[3];
    EACH(i, 3) f[i] = T[3 * i] * u[0] + T[3 * i + 1] * u[1] + T[3 * i + 2] * u[2];
    EACH(i, 3) f[i] -= (dl[i] + dc[i] * fabs(x[3 + i])) * x[3 + i];
    d[0] = c * x[3] - s * x[4], d[1] = s * x[3] + c * x[4], d[2] = x[5];
    d[3] = f[0] / m + x[4] * x[5], d[4] = f[1] / m - x[3] * x[5], d[5] = f[2] / I;
}

void simulate(int64_t n, const double *theta, const double *u, double *out) {
    double x[6] = {0}, p[17];
    memcpy(p, theta, sizeof p);
    for (int64_t t = 0; t < n; ++t, u += 3, out += 6) {
        double a[6], b[6], c[6], d[6], y[6];
        right_hand_side(x, u, p, a);
        EACH(i, 6) y[i] = x[i] + DT / 2 * a[i];
        right_hand_side(y, u, p, b);
        EACH(i, 6) y[i] = x[i] + DT / 2 * b[i];
        right_hand_side(y, u, p, c);
        EACH(i, 6) y[i] = x[i] + DT * c[i];
        right_hand_side(y, u, p, d);
        EACH(i, 6) out[i] = x[i] += DT / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    }
}

/* b: extended Kalman filter, constants folded; P as a full matrix */

static const double mass = 1.47, inertia = 810.44, linear[3] = {7, 7, 500.553}, quadratic[3] = {3.5, 3.5, 250};
static const double gain[3] = {1, 1, 29.99}, Q[3] = {0.0025, 0.0025, 0.000025};
static const double R[6] = {1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4};

static inline void acceleration(const double *nu, const double *u, double *a, double (*A)[3]) {
    double e[3], w[3] = {1 / mass, 1 / mass, 1 / inertia};
    EACH(i, 3) e[i] = linear[i] + quadratic[i] * fabs(nu[i]);
    EACH(i, 3) a[i] = (gain[i] * u[i] - e[i] * nu[i]) * w[i];
    a[0] += nu[1] * nu[2], a[1] -= nu[0] * nu[2];
    A[0][1] = nu[2], A[0][2] = nu[1], A[1][0] = -nu[2], A[1][2] = -nu[0], A[2][0] = A[2][1] = 0;
    EACH(i, 3) A[i][i] = -(e[i] + quadratic[i] * fabs(nu[i])) * w[i];
}

void filter(int64_t n, const double *u, const double *z, double *out) {
    double x[6] = {0}, P[6][6] = {{0}};
    EACH(i, 6) P[i][i] = 0.01;
    for (int64_t t = 0; t < n; ++t, u += 3, z += 3, out += 6) {
        double a[3], A[3][3], B[3][3], W[6][6], M[6][6], c = cos(x[2]), s = sin(x[2]);
        acceleration(x + 3, u, a, A);
        double y[6] = {c * x[3] - s * x[4], s * x[3] + c * x[4], x[5], a[0], a[1], a[2]};
        double g0 = -DT * y[1], g1 = DT * y[0], gc = DT * c, gs = DT * s; /* G = I + dt ∂f/∂x, B its corner */
        EACH(i, 6) y[i] = x[i] + DT * y[i];
        EACH(i, 3) EACH(j, 3) B[i][j] = (i == j) + DT * A[i][j];
        EACH(j, 6) {
            W[0][j] = P[0][j] + g0 * P[2][j] + gc * P[3][j] - gs * P[4][j];
            W[1][j] = P[1][j] + g1 * P[2][j] + gs * P[3][j] + gc * P[4][j];
            W[2][j] = P[2][j] + DT * P[5][j];
            EACH(i, 2) W[3 + i][j] = B[i][0] * P[3][j] + B[i][1] * P[4][j] + B[i][2] * P[5][j];
            W[5][j] = B[2][2] * P[5][j];
        }
        EACH(i, 6) {
            M[i][0] = W[i][0] + g0 * W[i][2] + gc * W[i][3] - gs * W[i][4];
            M[i][1] = W[i][1] + g1 * W[i][2] + gs * W[i][3] + gc * W[i][4];
            M[i][2] = W[i][2] + DT * W[i][5];
            EACH(j, 2) M[i][3 + j] = B[j][0] * W[i][3] + B[j][1] * W[i][4] + B[j][2] * W[i][5];
            M[i][5] = B[2][2] * W[i][5];
            M[i][i] += R[i];
        }
        acceleration(y + 3, u, a, A); /* only the velocities are measured: H (3, 3) */
        double H[3][3] = {{A[0][0], 0, 0}, {0, A[1][1], 0}, {0, 0, 1}};
        H[0][1] = A[0][1] - y[5], H[0][2] = A[0][2] - y[4], H[1][0] = A[1][0] + y[5], H[1][2] = A[1][2] + y[3];
        double r[3] = {z[0] - (a[0] - y[5] * y[4]), z[1] - (a[1] + y[5] * y[3]), z[2] - y[5]};
        double N[6][3], S[3][3], V[3][3], K[6][3], L[6][3], U[6][6];
        EACH(i, 6) EACH(j, 3) N[i][j] = M[i][3] * H[j][0] + M[i][4] * H[j][1] + M[i][5] * H[j][2];
        EACH(i, 3) EACH(j, 3) S[i][j] = H[i][0] * N[3][j] + H[i][1] * N[4][j] + H[i][2] * N[5][j];
        EACH(i, 3) S[i][i] += Q[i];
        double c0 = S[1][1] * S[2][2] - S[1][2] * S[1][2], c1 = S[0][2] * S[1][2] - S[0][1] * S[2][2];
        double c2 = S[0][1] * S[1][2] - S[0][2] * S[1][1], d = 1 / (S[0][0] * c0 + S[0][1] * c1 + S[0][2] * c2);
        V[0][0] = c0 * d, V[0][1] = V[1][0] = c1 * d, V[0][2] = V[2][0] = c2 * d;
        V[1][1] = (S[0][0] * S[2][2] - S[0][2] * S[0][2]) * d;
        V[2][2] = (S[0][0] * S[1][1] - S[0][1] * S[0][1]) * d;
        V[1][2] = V[2][1] = (S[0][1] * S[0][2] - S[0][0] * S[1][2]) * d;
        EACH(i, 6) EACH(j, 3) K[i][j] = N[i][0] * V[0][j] + N[i][1] * V[1][j] + N[i][2] * V[2][j];
        EACH(i, 6) out[i] = x[i] = y[i] + K[i][0] * r[0] + K[i][1] * r[1] + K[i][2] * r[2];
        EACH(i, 6) EACH(j, 3) L[i][j] = K[i][0] * H[0][j] + K[i][1] * H[1][j] + K[i][2] * H[2][j];
        EACH(i, 6) EACH(j, 6) U[i][j] = M[i][j] - L[i][0] * M[3][j] - L[i][1] * M[4][j] - L[i][2] * M[5][j];
        EACH(i, 6) for (int j = 0; j <= i; ++j) { /* (I − K H) M (I − K H)ᵀ + K Q Kᵀ */
            double joseph = U[i][j] - U[i][3] * L[j][0] - U[i][4] * L[j][1] - U[i][5] * L[j][2];
            EACH(k, 3) joseph += K[i][k] * Q[k] * K[j][k];
            P[i][j] = P[j][i] = joseph;
        }
    }
}

/* c: normal equations of a fit of θ (15,): d_l, d_c, the first and the last column of T by rows, the lag λ and the
   delay d of the motors, the bias of the gyro; 15 tangents are two vectors. A row: dt, u (2,), z (3,) */

typedef v8 row[2];
typedef struct {
    double v[2], lag[2], late[2]; /* an effort, its slopes by λ and by d */
} effort;

enum { LAG = 12, DELAY = 13, BIAS = 14 };

/* The effort over a tick as a straight line, and at its end; `left` of the tick before, `past` u and what lasted. */
static inline void efforts(const double *now, const double (*past)[3], double lag, double delay, effort *left,
                           effort *start, effort *mean, effort *end) {
    double dt = now[0], inv = 1 / dt, x = delay - past[0][0], to[2] = {x, delay};
    const double *u[3] = {past[1] + 1, past[0] + 1, now + 1};
    if (x <= 0) u[0] = u[1], u[1] = u[2], to[0] = delay, to[1] = dt;
    if (delay <= 0) u[0] = u[2], to[0] = dt;
    double edge[4] = {0, 0, 0, dt}, slope[4] = {0};
    EACH(k, 2) {
        edge[k + 1] = to[k] < 0 ? 0 : to[k] > dt ? dt : to[k];
        slope[k + 1] = to[k] > 0 && to[k] < dt;
    }
    effort m0 = {{0}}, m1 = {{0}};
    EACH(k, 3) {
        double a = edge[k], h = edge[k + 1] - a, da = slope[k], dh = slope[k + 1] - da;
        double E = exp(-h / lag), j0 = lag * (1 - E), j1 = lag * (j0 - h * E), r = h / lag;
        double j0_lag = 1 - E - E * r, j1_lag = j1 / lag + lag * j0_lag - E * h * r, E_lag = E * r / lag;
        double p = h * (2 * a + h), p_late = dh * (2 * a + h) + h * (2 * da + dh), q = a * j0 + j1;
        double q_late = da * j0 + (a + h) * E * dh, q_lag = a * j0_lag + j1_lag, E_late = -E / lag * dh;
        EACH(c, 2) {
            double w = u[k][c], y = left->v[c] - w;
            m0.v[c] += w * h + y * j0, m1.v[c] += w * p + 2 * y * q;
            m0.lag[c] += left->lag[c] * j0 + y * j0_lag, m1.lag[c] += 2 * (left->lag[c] * q + y * q_lag);
            m0.late[c] += w * dh + left->late[c] * j0 + y * E * dh;
            m1.late[c] += w * p_late + 2 * (left->late[c] * q + y * q_late);
            left->lag[c] = left->lag[c] * E + y * E_lag, left->late[c] = left->late[c] * E + y * E_late;
            left->v[c] = w + y * E;
        }
    }
    EACH(i, 6) { /* all three of an effort alike */
        double m = (&m0.v[0])[i] * inv, n = 3 * ((&m1.v[0])[i] * inv * inv - m);
        (&mean->v[0])[i] = m, (&start->v[0])[i] = m - n, (&end->v[0])[i] = m + n;
    }
}

static inline void tangents(const double *x, const row *X, const effort *e, const double *p, const row *E, double *d,
                            row *D) {
    const double *dl = p, *dc = p + 3, *T = p + 6, w[3] = {1 / mass, 1 / mass, 1 / inertia};
    EACH(i, 3) {
        double f = dl[i] + dc[i] * fabs(x[i]), g = -(f + dc[i] * fabs(x[i])) * w[i], *t = (double *)T + 2 * i;
        double by_lag = (t[0] * e->lag[0] + t[1] * e->lag[1]) * w[i];
        double by_delay = (t[0] * e->late[0] + t[1] * e->late[1]) * w[i];
        d[i] = (t[0] * e->v[0] + t[1] * e->v[1] - f * x[i]) * w[i];
        D[i][0] = g * X[i][0] - x[i] * w[i] * E[i][0] - x[i] * fabs(x[i]) * w[i] * E[3 + i][0];
        D[i][1] = g * X[i][1] + by_lag * E[LAG][1] + by_delay * E[DELAY][1];
        EACH(j, 2) {
            int b = (6 + 2 * i + j) / 8;
            D[i][b] += e->v[j] * w[i] * E[6 + 2 * i + j][b];
        }
    }
    d[0] += x[1] * x[2], d[1] -= x[0] * x[2];
    EACH(b, 2) D[0][b] += x[2] * X[1][b] + x[1] * X[2][b], D[1][b] -= x[2] * X[0][b] + x[0] * X[2][b];
}

void fit(int64_t n, const double *theta, const double *rows, double k, double *cost, double *gradient,
         double *hessian) {
    static const double weight[3] = {20, 20, 200};
    double p[15], x[3] = {0}, past[2][3] = {{1}, {1}}, sum = 0;
    effort left = {{0}};
    row E[15], X[3], G, H[15];
    memcpy(p, theta, sizeof p);
    memset(E, 0, sizeof E), memset(X, 0, sizeof X), memset(G, 0, sizeof G), memset(H, 0, sizeof H);
    EACH(j, 15) E[j][j / 8][j % 8] = 1;
    for (int64_t t = 0; t < n; ++t, rows += 6) {
        double dt = rows[0], a[3], b[3], c[3], d[3], y[3], r[3], w[3];
        const double *z = rows + 3;
        row A[3], B[3], C[3], D[3], Y[3], J[3], Z[3];
        effort start, mean, end;
        efforts(rows, (const double(*)[3])past, p[LAG], p[DELAY], &left, &start, &mean, &end);
        memcpy(past[1], past[0], sizeof past[0]), memcpy(past[0], rows, sizeof past[0]);
        tangents(x, X, &start, p, E, a, A);
        EACH(i, 3) { y[i] = x[i] + dt / 2 * a[i]; EACH(q, 2) Y[i][q] = X[i][q] + dt / 2 * A[i][q]; }
        tangents(y, Y, &mean, p, E, b, B);
        EACH(i, 3) { y[i] = x[i] + dt / 2 * b[i]; EACH(q, 2) Y[i][q] = X[i][q] + dt / 2 * B[i][q]; }
        tangents(y, Y, &mean, p, E, c, C);
        EACH(i, 3) { y[i] = x[i] + dt * c[i]; EACH(q, 2) Y[i][q] = X[i][q] + dt * C[i][q]; }
        tangents(y, Y, &end, p, E, d, D);
        EACH(i, 3) {
            x[i] += dt / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
            EACH(q, 2) X[i][q] += dt / 6 * (A[i][q] + 2 * B[i][q] + 2 * C[i][q] + D[i][q]);
        }
        tangents(x, X, &left, p, E, a, A);
        r[0] = (z[0] - a[0] + x[2] * x[1]) * weight[0];
        r[1] = (z[1] - a[1] - x[2] * x[0]) * weight[1];
        r[2] = (z[2] - x[2] - p[BIAS]) * weight[2];
        EACH(i, 3) {
            double size = fabs(r[i]);
            w[i] = size <= k ? 1 : k / size;
            sum += size <= k ? 0.5 * size * size : k * (size - 0.5 * k);
        }
        EACH(q, 2) {
            J[0][q] = (x[2] * X[1][q] + x[1] * X[2][q] - A[0][q]) * weight[0];
            J[1][q] = -(x[2] * X[0][q] + x[0] * X[2][q] + A[1][q]) * weight[1];
            J[2][q] = (X[2][q] + E[BIAS][q]) * -weight[2];
            EACH(i, 3) Z[i][q] = w[i] * J[i][q], G[q] += r[i] * Z[i][q];
        }
        EACH(j, 15) for (int q = j / 8; q < 2; ++q)
            H[j][q] += J[0][j / 8][j % 8] * Z[0][q] + J[1][j / 8][j % 8] * Z[1][q] + J[2][j / 8][j % 8] * Z[2][q];
    }
    *cost = sum;
    memcpy(gradient, G, 15 * sizeof(double));
    EACH(j, 15) memcpy(hessian + 15 * j, H[j], 15 * sizeof(double));
}

/* e: many vehicles, eight side by side */

static inline v8 size_of(v8 x) { return (v8)((m8)x & 0x7fffffffffffffff); }

static inline void turn(v8 x, v8 *s, v8 *c) {
    v8 t = x * 0.6366197723675814 + 0x1.8p52, n = t - 0x1.8p52;
    v8 r = (x - n * 0x1.921fb54442d18p+0) - n * 0x1.1a62633145c07p-54, z = r * r;
    v8 a = -1.984126983675712e-04 + z * (2.755731610179909e-06 + z * (-2.50511316880003e-08 + z * 1.5918117984e-10));
    v8 b = 2.4801587298764778e-05 + z * (-2.7557317271258515e-07 + z * (2.0876146170e-09 + z * -1.13826253e-11));
    a = r + r * z * (-0.16666666666666666 + z * (0.008333333333330948 + z * a));
    b = 1.0 - 0.5 * z + z * z * (0.041666666666666664 + z * (-0.0013888888888887398 + z * b));
    m8 q = (m8)t, even = (q & 1) == 0;
    *s = (v8)((((m8)a & even) | ((m8)b & ~even)) ^ ((q & 2) << 62));
    *c = (v8)((((m8)b & even) | ((m8)a & ~even)) ^ (((q + 1) & 2) << 62));
}

static inline void eight(const v8 *x, const v8 *tau, const v8 *p, v8 w, v8 wi, v8 *d) {
    v8 s, c;
    turn(x[2], &s, &c);
    d[0] = c * x[3] - s * x[4], d[1] = s * x[3] + c * x[4], d[2] = x[5];
    d[3] = (tau[0] - (p[0] + p[3] * size_of(x[3])) * x[3]) * w + x[4] * x[5];
    d[4] = (tau[1] - (p[1] + p[4] * size_of(x[4])) * x[4]) * w - x[3] * x[5];
    d[5] = (tau[2] - (p[2] + p[5] * size_of(x[5])) * x[5]) * wi;
}

void fleet(int64_t count, int64_t n, const double *theta, const double *u, double *final) {
    for (int64_t first = 0; first < count; first += 8) {
        v8 p[17], x[6] = {{0}};
        EACH(k, 17) EACH(l, 8) p[k][l] = theta[(first + l) * 17 + k];
        v8 w = 1.0 / p[15], wi = 1.0 / p[16];
        for (int64_t t = 0; t < n; ++t) {
            v8 tau[3], a[6], b[6], c[6], d[6], y[6];
            EACH(i, 3) tau[i] = p[6 + 3 * i] * u[3 * t] + p[7 + 3 * i] * u[3 * t + 1] + p[8 + 3 * i] * u[3 * t + 2];
            eight(x, tau, p, w, wi, a);
            EACH(i, 6) y[i] = x[i] + DT / 2 * a[i];
            eight(y, tau, p, w, wi, b);
            EACH(i, 6) y[i] = x[i] + DT / 2 * b[i];
            eight(y, tau, p, w, wi, c);
            EACH(i, 6) y[i] = x[i] + DT * c[i];
            eight(y, tau, p, w, wi, d);
            EACH(i, 6) x[i] += DT / 6 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
        }
        EACH(k, 6) EACH(l, 8) final[(first + l) * 6 + k] = x[k][l];
    }
}

/* The laws of controllers.py written by hand for the vehicle `small`, with its numbers as constants: zeros left out,
   derivatives by hand. A row of inputs: time [ns], η_r, ν_r, η, ν. Each law fills the commands (n, 3); only lqr reads
   P (3, 3), its cost before the first tick. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define EACH(i, n) for (int i = 0; i < (n); ++i)
#define FULL_TURN 6.283185307179586

static const double TICK = 0.01, D = 0.07, SMOOTH = 0.08, T = 0.15, arm = -0.008;
static const double mass = 0.61, inertia = 0.5 * 0.61 * 0.07 * 0.07, c = 0.008;
static const double push = 3.38 / 0.61, torque = 0.203 / inertia, aside = 40 / 0.61, twist = 0.008 * 40 / inertia;

static inline double wrap(double a) { return a - FULL_TURN * floor(a * (1 / FULL_TURN) + 0.5); }
static inline double clip(double x, double most) { return fmin(fmax(x, -most), most); }

/* PD of the paper */

void pd(int64_t n, const double *P, const double *row, double *u) {
    double before = -1, e_before = 0;
    for (int64_t k = 0; k < n; ++k, row += 13, u += 3) {
        double x = row[1] - row[7], y = row[2] - row[8], e = wrap(row[3] - row[9]), rate = 0;
        if (before >= 0 && row[0] > before) rate = wrap(e - e_before) / ((row[0] - before) * 1e-9);
        u[0] = clip(4 * (cos(row[9]) * x + sin(row[9]) * y), 1), u[1] = 0, u[2] = clip(e + 0.1 * rate, 1);
        before = row[0], e_before = e;
    }
}

/* The model: ν after a tick with the effort (forward, turn); M: what a linear change of ν becomes in ν̇. */

typedef struct { double xx, xy, xr, yx, yy, yr, ry, rr; } slopes;

static inline void acceleration(const double *v, double ahead, double turn, double *a, slopes *M) {
    double fast = fabs(v[0]), spin = fabs(v[2]), t = tanh(v[0] / 0.05), s = tanh(v[2] / 0.5);
    a[0] = push * ahead - ((3.3 + 0.8 * fast) * v[0] + 0.25 * t) / mass + v[2] * v[1] + c * v[2] * v[2];
    a[2] = torque * turn - ((0.0115 + 0.0003 * spin) * v[2] + 0.01 * s) / inertia + twist * v[1];
    a[1] = -aside * v[1] - v[2] * v[0] - c * a[2];
    if (!M) return;
    M->xx = -(3.3 + 1.6 * fast + 5 * (1 - t * t)) / mass, M->xy = v[2], M->xr = v[1] + 2 * c * v[2];
    M->ry = twist, M->rr = -(0.0115 + 0.0006 * spin + 0.02 * (1 - s * s)) / inertia;
    M->yx = -v[2], M->yy = -aside - c * twist, M->yr = -v[0] - c * M->rr;
}

static inline void advance(double *v, double ahead, double turn) {
    double k[4][3], w[3];
    acceleration(v, ahead, turn, k[0], 0);
    EACH(i, 3) w[i] = v[i] + TICK / 2 * k[0][i];
    acceleration(w, ahead, turn, k[1], 0);
    EACH(i, 3) w[i] = v[i] + TICK / 2 * k[1][i];
    acceleration(w, ahead, turn, k[2], 0);
    EACH(i, 3) w[i] = v[i] + TICK * k[2][i];
    acceleration(w, ahead, turn, k[3], 0);
    EACH(i, 3) v[i] += TICK / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
}

/* The same, and the changes g of ν per effort forward (g[0]) and turn (g[1]). */
static inline void advance_with_slopes(double *v, double ahead, double turn, double (*g)[3]) {
    static const double step[4] = {0, TICK / 2, TICK / 2, TICK}, weight[4] = {1, 2, 2, 1};
    double k[3], w[3], q[2][3], sum[3] = {0}, G[2][3] = {{0}};
    memcpy(w, v, sizeof w), memset(q, 0, sizeof q);
    EACH(stage, 4) {
        slopes M;
        EACH(i, 3) w[i] = stage ? v[i] + step[stage] * k[i] : v[i];
        acceleration(w, ahead, turn, k, &M);
        EACH(j, 2) {
            double h = step[stage], x = h * q[j][0], y = h * q[j][1], r = h * q[j][2];
            q[j][0] = M.xx * x + M.xy * y + M.xr * r + (j ? 0 : push);
            q[j][1] = M.yx * x + M.yy * y + M.yr * r - (j ? c * torque : 0);
            q[j][2] = M.ry * y + M.rr * r + (j ? torque : 0);
            EACH(i, 3) G[j][i] += weight[stage] * q[j][i];
        }
        EACH(i, 3) sum[i] += weight[stage] * k[i];
    }
    EACH(i, 3) v[i] += TICK / 6 * sum[i], g[0][i] = TICK / 6 * G[0][i], g[1][i] = TICK / 6 * G[1][i];
}

/* What all laws but the PD share */

typedef struct { double t, near, v, w, v_i, w_i, ahead, turn, m[3], a[3], b[3], d[3], P[4]; } memory;
typedef struct { double e_x, e_y, e_chi, v, w, kappa, forward, dt, g; } errors;
typedef void law(memory *, const errors *, double *, double *);

static inline double slip(double x, double y) { return atan(y * x / (x * x + 0.02 * 0.02)); }
static inline double low_pass(double x, double to, double time, double dt) { return x + dt / fmax(time, dt) * (to - x); }
static inline void limit_gains(double *k_chi, double *k_y, double v, double g) {
    double share = 1 / fmax(*k_chi * (1.35 * T), 1);
    *k_chi *= share;
    *k_y = fmin(*k_y, g * fmax(share * share * *k_y, *k_chi * *k_chi / fmax(1.69 * v, 1e-12)));
}

static inline __attribute__((always_inline)) void point_ahead(double x, double y, double chi, double kappa, double s,
                                                              double *px, double *py) {
    double angle = clip(kappa * s, 1), chord = s * (1 - angle * angle / 24), turned = chi + 0.5 * angle;
    *px = x + chord * cos(turned), *py = y + chord * sin(turned);
}

static inline double wheel(double w, double forward, double backward, double gain) { /* inverse */
    double size = fabs(w), zone = (w > 0 ? forward : backward) * fmin(size / (0.02 * gain), 1);
    return copysign((size + gain * zone) / gain, w);
}

static inline double response(double w, double forward, double backward, double gain) {
    w = clip(w, 1);
    return gain * (fmax(w - forward, 0) + fmin(w + backward, 0));
}

static inline __attribute__((always_inline)) void follow(memory *s, const double *row, double *u, law *compute) {
    const double *eta_r = row + 1, *nu_r = row + 4, *eta = row + 7, *nu = row + 10;
    int begun = s->t >= 0;
    double dt = begun ? (row[0] - s->t) * 1e-9 : TICK, v_b = begun ? s->v : nu[0], w_b = begun ? s->w : nu[2];
    double v_dot = clip((nu_r[0] - v_b) / SMOOTH, 1), w_dot = clip((nu_r[2] - w_b) / SMOOTH, 20);
    errors e = {.dt = dt, .v = v_b + v_dot * fmin(dt, SMOOTH), .w = w_b + w_dot * fmin(dt, SMOOTH)};
    if (begun) {
        double part = dt / fmax(0.5 * D, dt);
        advance(s->m, s->ahead, s->turn);
        EACH(i, 3) s->a[i] += part * (s->m[i] - s->a[i]), s->b[i] += part * (s->a[i] - s->b[i]);
        EACH(i, 3) s->d[i] = low_pass(s->d[i], nu[i] - s->b[i], 8 * T, dt);
    } else
        EACH(i, 3) s->m[i] = s->a[i] = s->b[i] = nu[i];
    double y_f = s->b[1] + s->d[1] + arm * (e.w - (s->b[2] + s->d[2]));
    double x = D * (0.5 * (s->a[0] + s->b[0]) + s->d[0]) + SMOOTH * e.v;
    double y = D * (0.5 * (s->a[1] + s->b[1]) + s->d[1]) + SMOOTH * y_f;
    double r = D * (0.5 * (s->a[2] + s->b[2]) + s->d[2]) + SMOOTH * e.w;
    double C = cos(eta[2] + 0.5 * r), S = sin(eta[2] + 0.5 * r), psi = eta[2] + r;
    double X = eta_r[0] - (eta[0] + C * x - S * y), Y = eta_r[1] - (eta[1] + S * x + C * y);
    e.e_chi = wrap(eta_r[2] + slip(nu_r[0], nu_r[1]) - psi - slip(e.v, y_f));
    double chi_c = cos(e.e_chi), chi_s = sin(e.e_chi);
    C = cos(psi), S = sin(psi);
    x = C * X + S * Y + arm * (1 - chi_c), y = C * Y - S * X - arm * chi_s;
    e.kappa = nu_r[2] * nu_r[0] / (nu_r[0] * nu_r[0] + 0.02 * 0.02);
    double slope = -(chi_c * x + chi_s * y) / fmax(1 + e.kappa * (chi_c * y - chi_s * x), 0.5), bend = e.kappa * slope;
    double arc = clip(slope / (1 + bend * bend / 3), fmin(0.5, 1 / fmax(fabs(e.kappa), 1e-12)));
    point_ahead(x, y, e.e_chi, e.kappa, arc, &e.e_x, &e.e_y);
    e.e_x = clip(e.e_x - arc, 0.3), e.e_chi += e.kappa * arc;
    if (fabs(e.e_y) >= 0.03)
        s->near = s->near >= 1 ? 2 : s->near;
    else
        s->near = s->near > 1 ? 0 : fmin(s->near + dt, 1);
    e.g = s->near > 1 ? 2 - 0.03 / fmax(fabs(e.e_y), 0.03) : 1;
    e.forward = e.v / sqrt(e.v * e.v + 0.02 * 0.02);
    double v, w, most = fabs(e.v) + 0.3, g[2][3];
    compute(s, &e, &v, &w);
    s->v_i = clip(s->v_i + 0.5 * e.e_x * dt, 0.5 * fabs(e.v));
    s->w_i = clip(low_pass(s->w_i, -s->d[2], 4 * T, dt), 0.5 * fabs(e.w) + fabs(e.v));
    double after[3] = {clip(v, most) + s->v_i, nu[1], w + s->w_i};
    double to_v = after[0] + v_dot * TICK, to_w = after[2] + w_dot * TICK;
    advance_with_slopes(after, s->ahead, s->turn, g);
    to_v -= after[0], to_w -= after[2];
    double square = g[0][0] * g[0][0] + g[1][0] * g[1][0], gain = to_v / (square + 0.001 * 0.001);
    double step[2] = {g[0][0] * gain, g[1][0] * gain};
    double along = (g[0][2] * g[0][0] + g[1][2] * g[1][0]) / (square + 1e-12);
    double b[2] = {g[0][2] - g[0][0] * along, g[1][2] - g[1][0] * along};
    gain = (to_w - g[0][2] * step[0] - g[1][2] * step[1]) / (b[0] * b[0] + b[1] * b[1] + 0.01 * 0.01);
    double ahead = clip(s->ahead + step[0] + b[0] * gain, 1), turn = clip(s->turn + step[1] + b[1] * gain, 1);
    double l = wheel(ahead - turn, 0.32, 0.34, 1.04), R = wheel(ahead + turn, 0.27, 0.29, 0.96);
    u[2] = clip(0.5 * (R - l), 1), u[1] = 0;
    u[0] = clip(clip(0.5 * (l + R), 1), fmax(0.98 - fabs(u[2]), 0));
    l = response(u[0] - u[2], 0.32, 0.34, 1.04), R = response(u[0] + u[2], 0.27, 0.29, 0.96);
    s->ahead = 0.5 * (l + R), s->turn = 0.5 * (R - l), s->t = row[0], s->v = e.v, s->w = e.w;
}

static inline double max_speed(const errors *e, double v) { return fabs(e->v) + fmin(fmax(fabs(v) - fabs(e->v), 0), 0.3); }

/* The laws */

#define LOCAL static inline __attribute__((always_inline)) void

LOCAL pd_feedforward_law(memory *s, const errors *e, double *v, double *w) {
    *v = e->v + e->e_x;
    double needed = 1.44 * max_speed(e, *v), k = fmax(4, fmin(needed / 0.25, 0.9 / (1.35 * T))), L = fmax(0.25, needed / k);
    *w = e->w + k * (e->e_chi + e->forward * atan(e->g * e->e_y / L));
}

LOCAL kanayama_law(memory *s, const errors *e, double *v, double *w) {
    double speed = max_speed(e, e->v + e->e_x), k = 9 * speed, k_y = 36 * speed;
    limit_gains(&k, &k_y, speed, e->g);
    *v = e->v * cos(e->e_chi) + e->e_x;
    *w = e->w + copysign(1, e->v) * clip(k_y * e->e_y, k * 0.7833269096274834) + k * sin(e->e_chi);
}

LOCAL pure_pursuit_law(memory *s, const errors *e, double *v, double *w) {
    double speed = max_speed(e, e->v + e->e_x), L = fmax(0.1, 2.45 * T * speed), far = e->e_y / 0.7602043991336763, x, y;
    double ahead = sqrt(fmax(L * L - e->e_y * e->e_y, far * far)), kappa = clip(e->kappa, 1 / ahead);
    double e_y = e->e_y * fmin(e->g, fmax(25 * L * L, 1));
    point_ahead(-sin(e->e_chi) * e_y, e_y, e->e_chi, kappa, e->forward * ahead, &x, &y);
    *v = e->v + e->e_x, *w = e->w + e->forward * speed * (2 * y / fmax(x * x + y * y, 0.25 * L * L) - kappa);
}

LOCAL stanley_law(memory *s, const errors *e, double *v, double *w) {
    double speed = max_speed(e, e->v + e->e_x), l = fmax(fmax(0.1, 0.25 * speed), 1.35 * T * speed);
    double rate = 6 * speed / (0.05 + speed);
    double k = speed / l + rate, k_y = rate / l;
    limit_gains(&k, &k_y, speed, e->g);
    double y = k_y * e->e_y + e->forward * (k - speed / l) * sin(e->e_chi);
    double delta = clip(e->e_chi + e->forward * clip(atan(y * l / fmax(speed, 1e-12)), 0.9), 1.2);
    *v = e->v + e->e_x, *w = e->w + speed * sin(delta) / l;
}

/* P has the entries xx, yy, yχ, χχ: along and across do not mix. */
LOCAL lqr_law(memory *s, const errors *e, double *v, double *w) {
    double slow = fabs(e->v) < 0.05, speed = slow ? (e->forward < 0 ? -0.05 : 0.05) : e->v, h = e->dt, *P = s->P;
    double a = speed * h, y = -0.5 * speed * h * h, k_x = -h * P[0] / (100 + h * h * P[0]);
    double n = y * P[1] - h * P[2], q = y * P[2] - h * P[3], det = 1 + y * n - h * q; /* B P (y, χ) */
    double k_y = n / det, k_c = (n * a + q) / det;
    P[0] = 100 + P[0] * (1 + h * k_x);
    double c00 = 1 - y * k_y, c01 = a - y * k_c, c10 = h * k_y, c11 = 1 + h * k_c; /* A − B K */
    double r0 = P[1] * c00 + P[2] * c10, r1 = P[1] * c01 + P[2] * c11, s0 = P[2] * c00 + P[3] * c10;
    double s1 = P[2] * c01 + P[3] * c11, off = 0.5 * (r1 + a * r0 + s0);
    P[1] = 1600 + r0, P[2] = off, P[3] = 9.765625 + a * r1 + s1;
    k_c = -k_c, k_y = fabs(k_y);
    *v = e->v - k_x * e->e_x;
    limit_gains(&k_c, &k_y, fmax(max_speed(e, *v), 0.05), e->g);
    *w = e->w + fabs(e->v) / speed * clip(k_y * e->e_y, 0.9 * k_c) + k_c * e->e_chi;
}

#define DRIVE(name)                                                                                                    \
    void name(int64_t n, const double *P, const double *row, double *u) {                                              \
        memory s = {.t = -1, .near = 1, .P = {P[0], P[4], P[5], P[8]}};                                                           \
        for (int64_t k = 0; k < n; ++k, row += 13, u += 3) follow(&s, row, u, name##_law);                             \
    }
DRIVE(pd_feedforward)
DRIVE(kanayama)
DRIVE(pure_pursuit)
DRIVE(stanley)
DRIVE(lqr)

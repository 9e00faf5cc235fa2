/* Elementary functions over GCC/Clang vectors of LANES doubles. This text is pasted once for each width that
   a kernel uses, after `#define LANES n`; names end in the width: sin_2, sin_8. Scalars are the first lane of
   a pair, so that one text serves them too: sin_1.

   Straight-line code without branches or calls, so that all lanes advance together. Coefficients are
   interpolants at Chebyshev nodes, with truncation errors below 2e-17 of the result. */
#ifndef FN
/* Of stdint.h and math.h, which gcc reads in 6 ms. */
typedef __INT64_TYPE__ int64_t;
typedef __UINT64_TYPE__ uint64_t;
typedef __INTPTR_TYPE__ intptr_t;

#define JOIN_(name, lanes) name##_##lanes
#define JOIN(name, lanes) JOIN_(name, lanes)
#define FN(name) JOIN(name, LANES)
#define REAL FN(v)
#define MASK FN(m)
#define LOCAL static inline __attribute__((always_inline, unused))
#ifdef CALLED /* long functions are called, where they are so many that the text would grow too long */
#define LONG static __attribute__((noinline, unused))
#else
#define LONG LOCAL
#endif

/* Numbers below 2.2e-308 become 0 from tiny_as_zero() to as_before(mode): derivatives that die out would pass
   through them, and processors take ten times as long there. */
#if defined(__SSE2__)
static inline __attribute__((unused)) unsigned int tiny_as_zero(void) {
    unsigned int mode = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(mode | 0x8040u);
    return mode;
}
static inline __attribute__((unused)) void as_before(unsigned int mode) { __builtin_ia32_ldmxcsr(mode); }
#else
static inline __attribute__((unused)) unsigned int tiny_as_zero(void) { return 0; }
static inline __attribute__((unused)) void as_before(unsigned int mode) { (void)mode; }
#endif

#define ROUND 0x1.8p52 /* x + ROUND has x, rounded to an integer, in its low bits */
#define SIGN ((long long)1 << 63)
#define INFINITE __builtin_inf()

/* x − n π/2, from parts of π/2. Fused, x − n times the first is exact; otherwise it is up to n = 2²⁰. */
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA) || defined(__aarch64__)
#define LESS_QUARTERS(x, n) (((x) - (n) * 0x1.921fb54442d18p+0) - (n) * 0x1.1a62633145c07p-54)
#else
#define LESS_QUARTERS(x, n) \
    ((((x) - (n) * 1.5707963267341256) - (n) * 6.077100506303966e-11) - (n) * 2.0222662487959506e-21)
#endif

/* Index of the cell of a table with xp[j] <= x < xp[j + 1], 0 <= j <= n - 2, from the given j on; NaN gives some valid
   cell. The first steps go cell by cell: a tick passes a few cells of a fine table. */
static __attribute__((noinline, pure, unused)) int64_t table_search(const double *xp, int64_t n, double x, int64_t j) {
    for (int step = 0; step < 4 && j < n - 1 && xp[j] <= x; ++step, ++j)
        if (x < xp[j + 1]) return j;
    int64_t low = 0;
    for (int64_t size = n - 1; size > 1;) {
        int64_t half = size / 2;
        low += xp[low + half] <= x ? half : 0;
        size -= half;
    }
    return low;
}

/* The same index; `at` keeps it, because the times of a route advance: the next cell is this one or its neighbour. */
LOCAL int64_t table_cell(const double *xp, int64_t n, double x, int64_t *at) {
    int64_t j = *at;
    if (j < n - 2 && xp[j + 1] <= x) ++j;
    if (!(xp[j] <= x && x < xp[j + 1])) j = table_search(xp, n, x, j);
    return *at = j;
}

/* Piecewise linear, held beyond the ends, as np.interp. */
LOCAL double interp_1(double x, const double *xp, const double *fp, int64_t n, int64_t *at) {
    if (x <= xp[0]) return fp[0];
    if (x >= xp[n - 1]) return fp[n - 1];
    int64_t j = table_cell(xp, n, x, at);
    return fp[j] + (x - xp[j]) * ((fp[j + 1] - fp[j]) / (xp[j + 1] - xp[j])); /* NaN in, NaN out */
}

LOCAL double interp_slope_1(double x, const double *xp, const double *fp, int64_t n, int64_t *at) {
    if (x < xp[0] || x > xp[n - 1]) return 0.0;
    int64_t j = table_cell(xp, n, x, at);
    return (fp[j + 1] - fp[j]) / (xp[j + 1] - xp[j]);
}
#endif

typedef double REAL __attribute__((vector_size(8 * LANES)));
typedef long long MASK __attribute__((vector_size(8 * LANES)));
#define EACH_LANE for (int lane = 0; lane < LANES; ++lane)

/* x − 0 keeps the sign of zero, x + 0 would not. */
LOCAL REAL FN(splat)(double x) { return x - (REAL){0}; }
LOCAL REAL FN(select)(MASK m, REAL a, REAL b) { return (REAL)(((MASK)a & m) | ((MASK)b & ~m)); }
LOCAL REAL FN(choose)(int c, REAL a, REAL b) { return FN(select)((MASK){0} - (long long)(c != 0), a, b); }
LOCAL REAL FN(gather)(const double *from, const int64_t *at) { /* a lane each from from[at[lane]] */
    REAL x;
    EACH_LANE x[lane] = from[at[lane]];
    return x;
}
LOCAL void FN(scatter)(double *to, const int64_t *at, REAL x) {
    EACH_LANE to[at[lane]] = x[lane];
}
LOCAL void FN(store)(double *to, REAL x, int count) { __builtin_memcpy(to, &x, 8 * count); }
LOCAL REAL FN(number)(MASK m) { return (REAL)((MASK)FN(splat)(1.0) & m); }
LOCAL REAL FN(abs)(REAL x) { return (REAL)((MASK)x & ~SIGN); }
LOCAL REAL FN(copysign)(REAL x, REAL s) { return (REAL)(((MASK)x & ~SIGN) | ((MASK)s & SIGN)); }
LOCAL REAL FN(sign)(REAL x) {
    REAL one = FN(copysign)(FN(splat)(1.0), x);
    return FN(select)((x < 0.0) | (x > 0.0), one, x + 0.0);
}
/* NaN of either stays. The instructions return b if one is NaN; gcc would not find them. */
#if LANES == 8 && defined(__AVX512F__) && !defined(__clang__)
#define INSTRUCTION(name, a, b) __builtin_ia32_##name##pd512_mask(a, b, a, -1, 4)
#elif LANES == 2 && defined(__SSE2__)
#define INSTRUCTION(name, a, b) __builtin_ia32_##name##pd(a, b)
#endif
#ifdef INSTRUCTION
LOCAL REAL FN(min)(REAL a, REAL b) { return FN(select)(a != a, a, INSTRUCTION(min, a, b)); }
LOCAL REAL FN(max)(REAL a, REAL b) { return FN(select)(a != a, a, INSTRUCTION(max, a, b)); }
#undef INSTRUCTION
#else
LOCAL REAL FN(min)(REAL a, REAL b) { return FN(select)((a < b) | (a != a), a, b); }
LOCAL REAL FN(max)(REAL a, REAL b) { return FN(select)((a > b) | (a != a), a, b); }
#endif
LOCAL REAL FN(sqrt)(REAL x) {
    REAL y;
    EACH_LANE y[lane] = __builtin_sqrt(x[lane]);
    return y;
}
LOCAL REAL FN(floor)(REAL x) {
    REAL y;
    EACH_LANE y[lane] = __builtin_floor(x[lane]);
    return y;
}
LOCAL REAL FN(pow)(REAL x, REAL y) {
    REAL z;
    EACH_LANE z[lane] = __builtin_pow(x[lane], y[lane]);
    return z;
}
LOCAL REAL FN(round)(REAL x) { return (x + ROUND) - ROUND; } /* |x| < 2⁵¹ */

/* √(a² + b²); squares are kept inside the range by a power of two. */
LONG REAL FN(hypot)(REAL a, REAL b) {
    a = FN(abs)(a), b = FN(abs)(b);
    REAL large = FN(select)(a > b, a, b);
    REAL up = FN(select)(large > 0x1p500, FN(splat)(0x1p-600), FN(splat)(1.0));
    up = FN(select)(large < 0x1p-400, FN(splat)(0x1p600), up);
    REAL down = FN(select)(large > 0x1p500, FN(splat)(0x1p600), FN(splat)(1.0));
    down = FN(select)(large < 0x1p-400, FN(splat)(0x1p-600), down);
    a *= up, b *= up;
    REAL r = FN(sqrt)(a * a + b * b) * down;
    return FN(select)((a == INFINITE) | (b == INFINITE), FN(splat)(INFINITE), r);
}

/* sin and cos of x: x = n π/2 + r, |r| <= π/4; the last two bits of n choose series and sign. The error is some
   1e-16 max(1, |x|), as is that of x itself; r = ±1 where x is so large that nothing is left of its angle. */
LOCAL MASK FN(quadrant)(REAL x, REAL *sine, REAL *cosine) {
    REAL shifted = x * 0.6366197723675814 + ROUND, n = shifted - ROUND;
    REAL r = FN(min)(FN(splat)(1.0), FN(max)(FN(splat)(-1.0), LESS_QUARTERS(x, n)));
    REAL z = r * r;
    REAL s = -2.5051131688000297e-08 + z * 1.5918117983848815e-10;
    s = 0.008333333333330948 + z * (-0.0001984126983675712 + z * (2.755731610179909e-06 + z * s));
    *sine = r + r * z * (-0.16666666666666666 + z * s);
    REAL c = 2.0876146170183976e-09 + z * -1.1382625349447592e-11;
    c = -0.0013888888888887398 + z * (2.4801587298764778e-05 + z * (-2.7557317271258515e-07 + z * c));
    *cosine = 1.0 + z * (-0.5 + z * (0.041666666666666664 + z * c));
    return (MASK)shifted;
}
/* The bits in which sin differs from its series s: those of the other series if n is odd, and the sign. */
LOCAL MASK FN(turned)(MASK n, REAL s, REAL c) {
    return (((MASK)s ^ (MASK)c) & ((n << 63) < 0)) ^ (n << 62 & SIGN);
}
LONG REAL FN(sin)(REAL x) {
    REAL s, c;
    MASK n = FN(quadrant)(x, &s, &c);
    return (REAL)((MASK)s ^ FN(turned)(n, s, c));
}
LONG REAL FN(cos)(REAL x) {
    REAL s, c;
    MASK n = FN(quadrant)(x, &s, &c);
    return (REAL)((MASK)c ^ FN(turned)(n, s, c) ^ (n << 63));
}
LONG REAL FN(tan)(REAL x) {
    REAL s, c;
    MASK even = (FN(quadrant)(x, &s, &c) & 1) == 0;
    return FN(select)(even, s, -c) / FN(select)(even, c, s);
}

LOCAL REAL FN(power_of_two)(REAL n) { /* n an integer in [-1022, 1023] */
    return (REAL)(((MASK)(n + ROUND) << 52) + 0x3ff0000000000000);
}
/* x = n ln 2 + r: returns e^r − 1. */
LOCAL REAL FN(exp_rest)(REAL x, REAL *n) {
    *n = FN(round)(x * 1.4426950408889634);
    REAL r = (x - *n * 0.6931471805592082) - *n * 7.371002565167799e-13;
    REAL e = 2.7557282931125736e-07 + r * (2.51004110820149e-08 + r * 2.091125490208877e-09);
    e = 0.00019841269863088255 + r * (2.4801587317169235e-05 + r * (2.7557268406190795e-06 + r * e));
    e = 0.041666666666666664 + r * (0.008333333333330055 + r * (0.0013888888888886548 + r * e));
    return r + r * r * (0.5 + r * (0.16666666666666669 + r * e));
}
/* 2^k e^x, k = 0 or -1; overflows to infinity, underflows through the subnormals. */
LOCAL REAL FN(scaled_exp)(REAL x, double k) {
    x = FN(select)(x > 720.0, FN(splat)(720.0), FN(select)(x < -760.0, FN(splat)(-760.0), x));
    REAL n, p = FN(exp_rest)(x, &n);
    n += k;
    REAL half = FN(round)(0.5 * n);
    return (1.0 + p) * FN(power_of_two)(half) * FN(power_of_two)(n - half);
}
LONG REAL FN(exp)(REAL x) { return FN(scaled_exp)(x, 0.0); }

/* e^x − 1 for 0 <= x <= 50, with small relative error down to x = 0. */
LOCAL REAL FN(exp_minus_one)(REAL x) {
    REAL n, p = FN(exp_rest)(x, &n), scale = FN(power_of_two)(n);
    return scale * p + (scale - 1.0);
}
LONG REAL FN(tanh)(REAL x) {
    REAL a = 2.0 * FN(abs)(x);
    REAL e = FN(exp_minus_one)(FN(select)(a > 44.0, FN(splat)(44.0), a));
    return FN(copysign)(e / (e + 2.0), x);
}
LONG REAL FN(sinh)(REAL x) {
    REAL a = FN(abs)(x);
    REAL e = FN(exp_minus_one)(FN(select)(a > 22.0, FN(splat)(22.0), a));
    REAL near = 0.5 * (e + e / (e + 1.0));
    return FN(copysign)(FN(select)(a < 22.0, near, FN(scaled_exp)(a, -1.0)), x);
}
LONG REAL FN(cosh)(REAL x) {
    REAL half = FN(scaled_exp)(FN(abs)(x), -1.0);
    return half + 0.25 / half;
}

/* x = 2^e m, √½ <= m < √2, f = m − 1, s = f / (2 + f):  ln m = f − f²/2 + s (f²/2 + s² L(s²)). */
LONG REAL FN(log)(REAL x) {
    MASK tiny = x < 0x1p-1022;
    MASK bits = (MASK)FN(select)(tiny, x * 0x1p54, x);
    MASK shifted = bits + (0x3ff0000000000000 - 0x3fe6a09e667f3bcd);
    MASK exponent = (shifted >> 52) & 0x7ff;
    REAL m = (REAL)((shifted & 0x000fffffffffffff) + 0x3fe6a09e667f3bcd);
    REAL e = (REAL)(exponent | 0x4330000000000000) - (0x1p52 + 1023.0);
    e -= FN(select)(tiny, FN(splat)(54.0), FN(splat)(0.0));
    REAL f = m - 1.0, s = f / (2.0 + f), z = s * s, h = 0.5 * f * f;
    REAL p = 0.18182890556695602 + z * (0.1533167403016786 + z * 0.1461703754879165);
    p = 0.3999999999989924 + z * (0.2857142862609589 + z * (0.2222221111514416 + z * p));
    p = z * (0.666666666666667 + z * p);
    REAL y = e * 0.6931471805592082 - ((h - (s * (h + p) + e * 7.371002565167799e-13)) - f);
    y = FN(select)(x < INFINITE, y, x); /* infinity and NaN stay */
    y = FN(select)(x < 0.0, FN(splat)(__builtin_nan("")), y);
    return FN(select)(x == 0.0, FN(splat)(-INFINITE), y);
}

/* Angle of (x, y) from a ratio of at most tan(π/8) = √2 − 1, then octants. */
LONG REAL FN(atan2)(REAL y, REAL x) {
    REAL ax = FN(abs)(x), ay = FN(abs)(y);
    MASK steep = ay > ax;
    REAL low = FN(select)(steep, ax, ay), high = FN(select)(steep, ay, ax);
    MASK turn = ((low > 0.41421356237309503 * high) | (low == high)) & (high != 0.0);
    REAL t = FN(select)(turn, low - high, low) / FN(select)(turn, low + high, high);
    t = FN(select)(low == high, FN(splat)(0.0), t); /* 0/0 and inf/inf are not a ratio */
    REAL z = t * t;
    REAL p = 0.05858145587628202 + z * (-0.050854323376990765 + z * (0.0392311556198723 + z * -0.01917627151752634));
    p = -0.09090904576954117 + z * (0.07692183163650894 + z * (-0.06664511064599371 + z * p));
    p = 0.19999999999995519 + z * (-0.14285714284666184 + z * (0.11111111015227572 + z * p));
    REAL angle = t + t * z * (-0.3333333333333333 + z * p);
    REAL none = FN(splat)(0.0);
    angle += FN(select)(turn, FN(splat)(3.061616997868383e-17), none);
    angle += FN(select)(turn, FN(splat)(0.7853981633974483), none);
    angle = FN(select)(steep, 1.5707963267948966 - (angle - 6.123233995736766e-17), angle);
    MASK behind = (MASK)x < 0; /* the sign bit: −0 too */
    angle = FN(select)(behind, 3.141592653589793 - (angle - 1.2246467991473532e-16), angle);
    return FN(select)((x != x) | (y != y), x + y, FN(copysign)(angle, y));
}
LOCAL REAL FN(atan)(REAL x) { return FN(atan2)(x, FN(splat)(1.0)); }
LOCAL REAL FN(asin)(REAL x) { return FN(atan2)(x, FN(sqrt)((1.0 - x) * (1.0 + x))); }
LOCAL REAL FN(acos)(REAL x) { return FN(atan2)(FN(sqrt)((1.0 - x) * (1.0 + x)), x); }

/* Lanes that read a route at the same time read one place of its table. */
LOCAL int FN(alike)(REAL x) {
    MASK other = x != FN(splat)(x[0]);
    long long some = 0;
    EACH_LANE some |= other[lane];
    return some == 0;
}
LOCAL REAL FN(interp)(REAL x, const double *xp, const double *fp, int64_t n, int64_t *at) {
    if (FN(alike)(x)) return FN(splat)(interp_1(x[0], xp, fp, n, at));
    REAL y;
    EACH_LANE y[lane] = interp_1(x[lane], xp, fp, n, at);
    return y;
}
LOCAL REAL FN(interp_slope)(REAL x, const double *xp, const double *fp, int64_t n, int64_t *at) {
    if (FN(alike)(x)) return FN(splat)(interp_slope_1(x[0], xp, fp, n, at));
    REAL y;
    EACH_LANE y[lane] = interp_slope_1(x[lane], xp, fp, n, at);
    return y;
}

#if LANES == 2
typedef double v_1;
typedef int m_1;
#define SCALAR(name) \
    LOCAL double name##_1(double x) { return name##_2(splat_2(x))[0]; }
#define SCALAR_OF_TWO(name) \
    LOCAL double name##_1(double x, double y) { return name##_2(splat_2(x), splat_2(y))[0]; }
SCALAR(sin)
SCALAR(cos)
SCALAR(tan)
SCALAR(asin)
SCALAR(acos)
SCALAR(atan)
SCALAR(exp)
SCALAR(log)
SCALAR(sinh)
SCALAR(cosh)
SCALAR(tanh)
SCALAR(sign)
SCALAR_OF_TWO(atan2)
SCALAR_OF_TWO(hypot)
/* Text, because compiling a call of each of many small functions takes longer than its arithmetic. */
#define splat_1(x) (x)
#define number_1(m) ((double)(m))
#define select_1(m, a, b) ((m) ? (a) : (b))
#define min_1(a, b) (((a) < (b)) | ((a) != (a)) ? (a) : (b))
#define max_1(a, b) (((a) > (b)) | ((a) != (a)) ? (a) : (b))
#define abs_1(x) __builtin_fabs(x)
#define sqrt_1(x) __builtin_sqrt(x)
#define floor_1(x) __builtin_floor(x)
LOCAL double pow_1(double x, double y) { return __builtin_pow(x, y); }
#endif

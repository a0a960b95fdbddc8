/* Contact forces over sampled periods and their exact derivatives: the compiled part of elastic_coulomb.py.
 * Compiled for several kinds of processor, see ../system/processors.h.
 *
 * The law of docs/theory.md, section 3, marched to its steady cycle.  Motion du_t and slider position w are relative to the
 * initial slider position w0, so that w = 0 at the start, T = k_t (du_t - w) and p_t = -k_t w.  With the slip distance
 * rho = mu N / k_t and r = du_t - w the pair sticks while |r| < rho (circle), or while each direction does (separate), and w
 * follows the motion where |r| would exceed rho.  rho = 0 (open, or mu = 0) is free sliding: w = du_t, and T and its derivative
 * vanish.
 *
 * From sample i to sample j the motion and N follow straight lines; the path of the slider in between is exact, or of second
 * order where slip changes its direction.  With "sampled" the return map is applied at j only.
 *
 * The derivative W = dw/dU has rows x, y and the columns of U_x, U_y, U_z.  A step in which the slider moves does, with rows e of E,
 *
 *     W <- A W + C_i (x) e_i + C_j (x) e_j,
 *
 * and W is constant while the pair sticks.  Hence dp_t/dU = -k_t sum over slips of (sum of F until the next slip) (x) W,
 * a product of two thin matrices with one row per slip, and a further row for the area of a step in which the state changes.
 *
 * Coefficients are [mean if there is one, then cos and sin of each harmonic]: there is a mean exactly if N_H is odd.  The
 * numbers of the harmonics enter through E and F only.
 *
 * LANES pairs are marched at once, as many as fit into a register of the processor: comparisons of longer vectors would be
 * compiled to scalar code.  The lane is the last index of arrays of samples.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "elastic_coulomb.h"

#ifndef KERNEL
#define KERNEL(name) name##_baseline
#endif

#define INLINED static inline __attribute__((always_inline))

#ifndef LANES
#define LANES 2                                     /* pairs marched at once */
#endif
enum { CHUNK = 32 };                                /* slips per matrix product */
enum { STICK = 0, SLIP = 1, OPEN = 2 };
enum { MOST_PERIODS = 100 };                         /* after which a slider that still drifts keeps its position */
enum { ROUND = 4 };                                 /* periods after which pairs with a steady cycle leave their group */
enum { CORNER_AFTER = 6 };                          /* periods between searches for a corner */
enum { NEWTON_AFTER = 24 };                         /* periods from which Newton's method looks for the cycle, every CORNER_AFTER */
static const double SETTLED = 1e-14;                /* largest change of w in a steady period, relative to the slip distance */
static const double ROUNDING = 1e-15;               /* the same relative to the motion */
static const double SLOWEST = 1.0 - 1e-6;           /* convergence rate of a period above which no secant step is made */
static const double NEAR_LIMIT = 1e-7;              /* relative distance from the limit where lengths need one correction step */
static const double ON_LIMIT = 1e-12;               /* relative distance from the friction limit that counts as zero */
static const double FORGOTTEN = 1e-20;              /* fraction of an older W that is below roundoff */
static const double MOVES = 1e-14;                  /* smallest relative slider step above roundoff */

#pragma GCC diagnostic ignored "-Wpsabi"            /* lanes are never passed: every function that takes them is inlined */
typedef double lanes __attribute__((vector_size(LANES * sizeof(double)), may_alias));
typedef long long mask __attribute__((vector_size(LANES * sizeof(double)), may_alias));

INLINED lanes pick(mask chosen, lanes a, lanes b)
{
    return (lanes)((chosen & (mask)a) | (~chosen & (mask)b));
}

INLINED lanes row(const double *values, index_t j)
{
    return *(const lanes *)(values + j * LANES);
}

INLINED lanes size_of(lanes a)
{
    return pick(a < 0.0, -a, a);
}

INLINED lanes root(lanes a)                         /* 0 for negative values */
{
    double values[LANES] __attribute__((aligned(sizeof(lanes))));
    *(lanes *)values = pick(a > 0.0, a, a - a);
    for (int l = 0; l < LANES; l++)
        values[l] = sqrt(values[l]);
    return *(const lanes *)values;
}

INLINED int any(mask a)                             /* a has all bits of a lane, or none */
{
#if LANES == 8 && defined(__AVX512DQ__)
    return __builtin_ia32_cvtq2mask512((long long __attribute__((vector_size(64))))a) != 0;
#elif LANES == 4 && defined(__AVX__)
    return __builtin_ia32_movmskpd256((double __attribute__((vector_size(32))))a) != 0;
#elif LANES == 2 && defined(__SSE2__)
    return __builtin_ia32_movmskpd((double __attribute__((vector_size(16))))a) != 0;
#else
    long long values[LANES] __attribute__((aligned(sizeof(mask)))), bits = 0;
    *(mask *)values = a;
    for (int l = 0; l < LANES; l++)
        bits |= values[l];
    return bits != 0;
#endif
}

typedef struct {                                    /* one group of LANES pairs */
    double N0[LANES] __attribute__((aligned(sizeof(lanes)))), k_t[LANES], k_n[LANES];
    double give[LANES];                             /* mu / k_t, slip distance per normal force */
    double start[3 * LANES];                        /* du at rest relative to the initial slider position, -w0 */
    double *U;                                      /* (N_H, 3, LANES) */
    double *du;                                     /* (N_t, 3, LANES) relative to the initial slider position */
    double *rho;                                    /* (N_t, LANES) slip distance; infinite where k_t = 0 */
    double *per_rho;                                /* (N_t, LANES) 1 / rho */
    double *N;                                      /* (N_t, LANES) N0 - k_n du_z: the normal force, or -k_n times the opening */
    double *force;                                  /* (N_t, 3, LANES) p at the samples of the last period */
    double before[2 * LANES];                       /* sliders at the end of the previous period */
    double *slider;                                 /* (N_t, 2, LANES) w at the samples of the last period */
    double *area;                                   /* (N_t, 2, LANES) of the steps to the samples */
    double *slides;                                 /* (N_t, LANES) 1 where the slider moves in the step to the sample */
    union {
        lanes all;
        double each[LANES];
    } slipped;                                      /* in the last period */
    double opened[LANES] __attribute__((aligned(sizeof(lanes))));
    int at_corner[LANES];                           /* whether the slider drifted to a corner, held by two samples, */
    index_t corners[2 * LANES];                     /* and the numbers of these samples */
    double *p;                                      /* (N_H, 3, LANES) */
    struct step_map *maps;                          /* (N_t,) of the steps in which the slider of one pair moves */
    index_t *events;                                /* (N_t,) samples at the ends of these steps */
    double *W;                                      /* (CHUNK + 1, 2, 3, stride) */
    double *G;                                      /* (CHUNK, stride) */
    double *sum;                                    /* (N_H, 2, 3, stride) */
} aft_group;

/* ---- matrix products -------------------------------------------------------------------------------------------- */

/* add_product for a fixed number of rows, all in one pass over sum. */
INLINED void add_rows(double *restrict sum, const double *G, const double *W, const int n, index_t n_out,
                      index_t stride, const index_t width)
{
    for (index_t i = 0; i < n_out; i++) {
        double *restrict to = sum + i * width;
        for (index_t q = 0; q < width; q++) {
            double value = to[q];
            for (int k = 0; k < n; k++)
                value += G[k * stride + i] * W[k * width + q];
            to[q] = value;
        }
    }
}

/* sum += G^T W over n rows: sum (n_out, width), the first n_out columns of G (n, stride), W (n, width). */
INLINED void add_product(double *sum, const double *G, const double *W, index_t n, index_t n_out,
                         index_t stride, const index_t width)
{
    index_t k = 0;
    for (; k + 8 <= n; k += 8)
        add_rows(sum, G + k * stride, W + k * width, 8, n_out, stride, width);
    for (; k + 4 <= n; k += 4)
        add_rows(sum, G + k * stride, W + k * width, 4, n_out, stride, width);
    for (; k + 2 <= n; k += 2)
        add_rows(sum, G + k * stride, W + k * width, 2, n_out, stride, width);
    if (k < n)
        add_rows(sum, G + k * stride, W + k * width, 1, n_out, stride, width);
}

/* ---- samples ---------------------------------------------------------------------------------------------------- */

INLINED void gather(aft_group *group, const aft_pairs *pairs, const index_t *chosen, index_t N_H)
{
    for (int l = 0; l < LANES; l++) {
        const index_t i = chosen[l];
        const double *U = pairs->U + 3 * N_H * i;
        group->N0[l] = pairs->N0[i];
        group->k_t[l] = pairs->k_t[i];
        group->k_n[l] = pairs->k_n[i];
        group->give[l] = pairs->k_t[i] > 0.0 ? pairs->mu[i] / pairs->k_t[i] : 0.0;
        group->start[l] = 0.0 - pairs->w0[2 * i];
        group->start[LANES + l] = 0.0 - pairs->w0[2 * i + 1];
        group->start[2 * LANES + l] = 0.0;
        for (int a = 0; a < 3; a++)
            for (index_t h = 0; h < N_H; h++)
                group->U[(3 * h + a) * LANES + l] = U[a * N_H + h];
    }
}

/* The motion at the samples, the normal force, eq. (3.1), and rho. */
INLINED void sample(aft_group *group, const aft_tables *t)
{
    for (index_t j = 0; j < t->N_t; j++)
        for (int c = 0; c < 3 * LANES; c++)
            group->du[3 * j * LANES + c] = group->start[c];
    add_product(group->du, t->E_T, group->U, t->N_H, t->N_t, t->N_t, 3 * LANES);
    for (index_t j = 0; j < t->N_t; j++)
        for (int l = 0; l < LANES; l++) {
            const double N = group->N0[l] - group->k_n[l] * group->du[(3 * j + 2) * LANES + l];
            const double rho = N > 0.0 ? group->give[l] * N : 0.0;
            group->N[j * LANES + l] = N;
            group->rho[j * LANES + l] = group->k_t[l] > 0.0 ? rho : INFINITY;
            group->per_rho[j * LANES + l] = 1.0 / group->rho[j * LANES + l];
        }
}

/* ---- which pairs leave sticking --------------------------------------------------------------------------------- */

INLINED double mean_of(const double *U, index_t N_H)
{
    return N_H % 2 ? U[0] : 0.0;
}

/* An upper bound of the distance of any sample from the mean. */
INLINED double amplitude_bound(const double *U, index_t N_H)
{
    double bound = 0.0;
    for (index_t h = N_H % 2; h < N_H; h += 2)
        bound += sqrt(U[h] * U[h] + U[h + 1] * U[h + 1]);
    return bound;
}

/* True if the pair is stuck and closed even with all harmonics at their peak together: true of most pairs in micro-slip. */
INLINED int surely_stuck(const aft_pairs *pairs, index_t i, index_t N_H)
{
    const double *x = pairs->U + 3 * N_H * i, *y = x + N_H, *z = y + N_H, margin = 1.0 - 1e-12;
    const double N_least = pairs->N0[i] - pairs->k_n[i] * (mean_of(z, N_H) + amplitude_bound(z, N_H));
    if (!(pairs->N0[i] >= 0.0 && N_least > 1e-12 * pairs->N0[i]))
        return 0;
    const double x_most = fabs(mean_of(x, N_H) - pairs->w0[2 * i]) + amplitude_bound(x, N_H);
    const double y_most = fabs(mean_of(y, N_H) - pairs->w0[2 * i + 1]) + amplitude_bound(y, N_H);
    const double limit = margin * pairs->mu[i] * N_least;
    return limit > 0.0 && pairs->k_t[i] * sqrt(x_most * x_most + y_most * y_most) <= limit;
}

INLINED void test_samples(aft_group *group, const aft_pairs *pairs, const aft_tables *t, const index_t *chosen,
                          int n_lanes, unsigned char *leaves)
{
    gather(group, pairs, chosen, t->N_H);
    sample(group, t);
    for (int l = 0; l < n_lanes; l++) {
        int stays = group->N0[l] >= 0.0;
        const int separate = pairs->separate[chosen[l]];
        for (index_t j = 0; stays && j < t->N_t; j++) {
            const double *du = group->du + 3 * j * LANES + l, rho = group->rho[j * LANES + l];
            const double x = du[0], y = du[LANES];
            const int inside = separate ? fabs(x) <= rho && fabs(y) <= rho : x * x + y * y <= rho * rho;
            stays = inside && rho > 0.0 && group->N[j * LANES + l] > 0.0;
        }
        leaves[chosen[l]] = !stays;
    }
}

/* ---- a step from one sample to the next ------------------------------------------------------------------------- */

/* Within a step the motion and the normal force run along straight lines, on which the slider's path is known, eq. (3.6).
 * The part of the step in which the pair is closed and has friction is from s_0 to s_1, 0 and 1 except for a pair that closes or
 * opens.  The slider sticks until sigma, the fraction of that part at which |r| = rho, and then slides. */

/* The area between a slider's path in a step, w_i until s_0, w_a until sigma, w_b at s_1, w_j at the end, and the line w_i w_j,
 * eq. (6.4). */
INLINED lanes polygon_area(lanes s_0, lanes sigma, lanes s_1, lanes w_i, lanes w_a, lanes w_b, lanes w_j)
{
    return 0.5 * (s_0 * (w_i + w_a) + (s_1 - sigma) * (w_a + w_b) + (1.0 - s_1) * (w_b + w_j) - (w_i + w_j))
           + (sigma - s_0) * w_a;
}

typedef struct {                                    /* data of a step for all lanes */
    lanes rho_i, rho_j, s_0, s_1;
    mask free_i, free_j, is_free;
} step;

INLINED step begin_step(const aft_group *group, index_t i, index_t j)
{
    step s;
    s.rho_i = row(group->rho, i);
    s.rho_j = row(group->rho, j);
    s.free_i = s.rho_i <= 0.0;
    s.free_j = s.rho_j <= 0.0;
    s.is_free = s.free_i & s.free_j;
    s.s_0 = (lanes){0.0};
    s.s_1 = s.s_0 + 1.0;
    if (any(s.free_i ^ s.free_j)) {
        const lanes N_i = row(group->N, i), crossing = N_i / (N_i - row(group->N, j));
        s.s_0 = pick(s.free_i & ~s.free_j, crossing, s.s_0);
        s.s_1 = pick(s.free_j & ~s.free_i, crossing, s.s_1);
    }
    return s;
}

/* circle_step where no lane is free and every lane that slips does so from the start of the step on, on its circle: sigma is 0 and
 * no path has an area.  Returns 0, without an effect, for any other step. */
INLINED int slide(const aft_group *group, index_t i, index_t j, lanes *w, lanes *slides, lanes *slipped)
{
    const lanes zero = {0.0}, one = zero + 1.0, rho_i = row(group->rho, i), rho_j = row(group->rho, j), per_rho = row(group->per_rho, i);
    const lanes ui_x = row(group->du, 3 * i), ui_y = row(group->du, 3 * i + 1);
    const lanes uj_x = row(group->du, 3 * j), uj_y = row(group->du, 3 * j + 1);
    const lanes V_x = uj_x - ui_x, V_y = uj_y - ui_y, d_rho = rho_j - rho_i, r_x = ui_x - w[0], r_y = ui_y - w[1];
    const lanes x = uj_x - w[0], y = uj_y - w[1], square = r_x * r_x + r_y * r_y, relative = square * per_rho * per_rho;
    const lanes b = r_x * V_x + r_y * V_y - rho_i * d_rho, q = V_x * V_x + V_y * V_y, chord = root(q);
    const lanes rho_square = rho_i * rho_i, c = square - rho_square;
    const mask slips = x * x + y * y > rho_j * rho_j;
    const mask at_once = ((c >= -ON_LIMIT * rho_square) & (b > 0.0)) | ((b <= 0.0) & (q <= d_rho * d_rho));
    if (any(slips & ~(at_once & (size_of(relative - 1.0) < NEAR_LIMIT))))
        return 0;
    const lanes per_size = per_rho * (1.5 - 0.5 * relative), d_x = r_x * per_size, d_y = r_y * per_size;
    const lanes p = 0.5 * (rho_i + rho_j), pp = p * p, half = p + 0.5 * chord, Y = pp + chord * half;
    const lanes dq = (d_x * V_x + d_y * V_y) * half, den = Y * Y + pp * pp + dq * (Y + pp), turn = half * (Y + pp + dq);
    const mask turns = den > 0.0;
    const lanes inverse = 1.0 / pick(turns, den, one), stays = 2.0 * Y * pp;
    const lanes t_x = pick(turns, (stays * d_x + turn * V_x) * inverse, d_x), t_y = pick(turns, (stays * d_y + turn * V_y) * inverse, d_y);
    const lanes to_x = pick(slips, uj_x - rho_j * t_x, w[0]), to_y = pick(slips, uj_y - rho_j * t_y, w[1]);
    const lanes moved = size_of(to_x - w[0]) + size_of(to_y - w[1]);
    const lanes roundoff = MOVES * (size_of(uj_x) + size_of(uj_y) + size_of(w[0]) + size_of(w[1]));
    *slides = pick(slips, one, zero);
    *slipped = pick(slips & (moved > roundoff), one, *slipped);
    w[0] = to_x;
    w[1] = to_y;
    return 1;
}

/* One step on all lanes, eq. (3.6): updates w, writes the area between the path of w in the step and the straight line between
 * its ends, and marks lanes whose slider moves (slides), and moves by more than roundoff (slipped). */
INLINED void circle_step(const aft_group *group, index_t i, index_t j, lanes *w, lanes *area, lanes *slides, lanes *slipped)
{
    const lanes zero = {0.0}, one = zero + 1.0, was_x = w[0], was_y = w[1];
    const lanes ui_x = row(group->du, 3 * i), ui_y = row(group->du, 3 * i + 1);
    const lanes uj_x = row(group->du, 3 * j), uj_y = row(group->du, 3 * j + 1);
    const step s = begin_step(group, i, j);
    const mask either = s.free_i | s.free_j;
    const lanes out_x = uj_x - was_x, out_y = uj_y - was_y;
    if (!any(either | (out_x * out_x + out_y * out_y > s.rho_j * s.rho_j))) {
        area[0] = area[1] = *slides = zero;
        return;
    }
    if (!any(either) && slide(group, i, j, w, slides, slipped)) {
        area[0] = area[1] = zero;
        return;
    }
    const lanes v_x = uj_x - ui_x, v_y = uj_y - ui_y;
    const lanes a_x = ui_x + s.s_0 * v_x, a_y = ui_y + s.s_0 * v_y;                    /* start of the closed part */
    const lanes b_x = pick(s.free_j, ui_x + s.s_1 * v_x, uj_x), b_y = pick(s.free_j, ui_y + s.s_1 * v_y, uj_y);    /* its end */
    const lanes w_x = pick(s.free_i, a_x, was_x), w_y = pick(s.free_i, a_y, was_y);    /* a free slider follows the motion */
    const lanes V_x = b_x - a_x, V_y = b_y - a_y, d_rho = s.rho_j - s.rho_i;
    const lanes r_x = a_x - w_x, r_y = a_y - w_y, x = b_x - w_x, y = b_y - w_y;
    const mask slips = (x * x + y * y > s.rho_j * s.rho_j) & ~s.is_free;
    /* |r + s V|^2 = (rho + s d_rho)^2, once from inside to outside */
    const lanes inside = r_x * r_x + r_y * r_y - s.rho_i * s.rho_i, c = pick(inside < 0.0, inside, zero), b = r_x * V_x + r_y * V_y - s.rho_i * d_rho;
    const lanes a = V_x * V_x + V_y * V_y - d_rho * d_rho, on = ON_LIMIT * s.rho_i * s.rho_i;
    const mask at_once = ((c >= -on) & (b > 0.0)) | ((b <= 0.0) & (a <= 0.0));
    lanes sigma = zero, per_rho = row(group->per_rho, i);
    if (any(slips & ~at_once)) {
        const lanes S = root(b * b - a * c), above = pick(b > 0.0, -c, S - b), below = pick(b > 0.0, b + S, a), crossed = above / below;
        sigma = pick(at_once | ~slips, zero, pick(crossed < 1.0, crossed, one));
        per_rho = 1.0 / (s.rho_i + sigma * d_rho);
    }
    const lanes rest = 1.0 - sigma, rho_s = s.rho_i + sigma * d_rho;
    const lanes q_x = rest * V_x, q_y = rest * V_y, at_x = r_x + sigma * V_x, at_y = r_y + sigma * V_y;
    const lanes chord = root(q_x * q_x + q_y * q_y), square = (at_x * at_x + at_y * at_y) * per_rho * per_rho;
    const mask on_circle = size_of(square - 1.0) < NEAR_LIMIT;
    lanes per_size = per_rho * (1.5 - 0.5 * square), d_x = at_x * per_size, d_y = at_y * per_size;
    if (any(slips & ~on_circle)) {                      /* at the start of the march, or where friction begins */
        const lanes size = root(at_x * at_x + at_y * at_y);
        const mask outside = size > 0.0;
        per_size = 1.0 / pick(outside, size, pick(chord > 0.0, chord, one));
        d_x = pick(on_circle, d_x, pick(outside, at_x, q_x) * per_size);
        d_y = pick(on_circle, d_y, pick(outside, at_y, q_y) * per_size);
    }
    /* rotation of d towards the motion, eq. (3.6), multiplied by the fourth power of a length */
    const lanes p = 0.5 * (rho_s + s.rho_j), pp = p * p, half = p + 0.5 * chord, Y = pp + chord * half;
    const lanes dq = (d_x * q_x + d_y * q_y) * half, den = Y * Y + pp * pp + dq * (Y + pp), turn = half * (Y + pp + dq);
    const mask turns = den > 0.0;
    const lanes inverse = 1.0 / pick(turns, den, one), stays = 2.0 * Y * pp;
    const lanes t_x = pick(turns, (stays * d_x + turn * q_x) * inverse, d_x), t_y = pick(turns, (stays * d_y + turn * q_y) * inverse, d_y);
    const lanes to_x = pick(slips, b_x - s.rho_j * t_x, w_x), to_y = pick(slips, b_y - s.rho_j * t_y, w_y);
    const lanes from = pick(slips, s.s_0 + sigma * (s.s_1 - s.s_0), s.s_1);
    w[0] = pick(s.free_j, uj_x, to_x);
    w[1] = pick(s.free_j, uj_y, to_y);
    area[0] = pick(s.is_free, zero, polygon_area(s.s_0, from, s.s_1, was_x, w_x, to_x, w[0]));
    area[1] = pick(s.is_free, zero, polygon_area(s.s_0, from, s.s_1, was_y, w_y, to_y, w[1]));
    const lanes moved = size_of(w[0] - was_x) + size_of(w[1] - was_y);
    const lanes roundoff = MOVES * (size_of(uj_x) + size_of(uj_y) + size_of(was_x) + size_of(was_y));
    *slides = pick(slips | either, one, zero);
    *slipped = pick((slips & (moved > roundoff)) | either, one, *slipped);
}

/* circle_step for separate limits: each direction separately. */
INLINED void separate_step(const aft_group *group, index_t i, index_t j, lanes *w, lanes *area, lanes *slides, lanes *slipped)
{
    const lanes zero = {0.0}, one = zero + 1.0;
    const step s = begin_step(group, i, j);
    const mask either = s.free_i | s.free_j;
    *slides = zero;
    for (int k = 0; k < 2; k++) {
        const lanes u_i = row(group->du, 3 * i + k), u_j = row(group->du, 3 * j + k), v = u_j - u_i, was = w[k];
        const lanes a = u_i + s.s_0 * v, b = pick(s.free_j, u_i + s.s_1 * v, u_j), w_a = pick(s.free_i, a, was);
        const lanes r = b - w_a, sign = pick(r < 0.0, -one, one);
        const lanes excess = sign * r - s.rho_j, before = sign * (a - w_a) - s.rho_i;
        const mask slips = (excess > 0.0) & ~s.is_free;
        const lanes sigma = pick(slips & (before < -ON_LIMIT * s.rho_i), before / (before - excess), zero);
        const lanes to = pick(slips, b - sign * s.rho_j, w_a), from = pick(slips, s.s_0 + sigma * (s.s_1 - s.s_0), s.s_1);
        w[k] = pick(s.free_j, u_j, to);
        area[k] = pick(s.is_free, zero, polygon_area(s.s_0, from, s.s_1, was, w_a, to, w[k]));
        const lanes roundoff = MOVES * (size_of(u_j) + size_of(was));
        *slides = pick(slips | either, one, *slides);
        *slipped = pick((slips & (size_of(w[k] - was) > roundoff)) | either, one, *slipped);
    }
}

/* The return map, eq. (3.3), which uses only the ends of steps. */
INLINED void sampled_circle_step(const aft_group *group, index_t j, double *w, double *slides, double *slipped)
{
    const double *du = group->du + 3 * j * LANES, *rho = group->rho + j * LANES;
    for (int l = 0; l < LANES; l++) {
        const double x = du[l] - w[l], y = du[LANES + l] - w[LANES + l];
        const double square = x * x + y * y, size = sqrt(square);
        const double alpha = rho[l] / (size > 0.0 ? size : 1.0);
        const int is_free = rho[l] == 0.0, slips = (square > rho[l] * rho[l]) | is_free;
        const double roundoff = MOVES * (fabs(du[l]) + fabs(du[LANES + l]) + fabs(w[l]) + fabs(w[LANES + l]));
        slipped[l] = (slips & ((size - rho[l] > roundoff) | is_free)) ? 1.0 : slipped[l];
        slides[l] = slips ? 1.0 : 0.0;
        w[l] = slips ? du[l] - alpha * x : w[l];
        w[LANES + l] = slips ? du[LANES + l] - alpha * y : w[LANES + l];
    }
}

INLINED void sampled_separate_step(const aft_group *group, index_t j, double *w, double *slides, double *slipped)
{
    const double *du = group->du + 3 * j * LANES, *rho = group->rho + j * LANES;
    for (int l = 0; l < LANES; l++) {
        const int is_free = rho[l] == 0.0;
        slides[l] = 0.0;
        for (int a = 0; a < 2; a++) {
            const double r = du[a * LANES + l] - w[a * LANES + l], size = fabs(r);
            const int slips = (size > rho[l]) | is_free;
            const double roundoff = MOVES * (fabs(du[a * LANES + l]) + fabs(w[a * LANES + l]));
            slipped[l] = (slips & ((size - rho[l] > roundoff) | is_free)) ? 1.0 : slipped[l];
            slides[l] = slips ? 1.0 : slides[l];
            w[a * LANES + l] = slips ? du[a * LANES + l] - (r < 0.0 ? -rho[l] : rho[l]) : w[a * LANES + l];
        }
    }
}

/* ---- march to the steady cycle ---------------------------------------------------------------------------------- */

/* The start of the step to sample j: sample 0 itself in the first period, so that sliders return within their limits there. */
INLINED index_t begin_of(index_t j, index_t N_t, int is_first)
{
    return j > 0 ? j - 1 : is_first ? 0 : N_t - 1;
}

/* One period on all lanes from w, step by step to each sample; its record is stored until the next period.  The return map leaves
 * the very first sample unchanged, with w = w0. */
INLINED void march_period(aft_group *group, index_t N_t, int separate, int sampled, int is_first, double *w)
{
    memset(&group->slipped, 0, sizeof group->slipped);
    memcpy(group->before, w, sizeof group->before);
    if (is_first && sampled) {
        memcpy(group->slider, w, sizeof group->before);
        memset(group->area, 0, 2 * LANES * sizeof(double));
        memset(group->slides, 0, LANES * sizeof(double));
    }
    for (index_t j = is_first && sampled; j < N_t; j++) {
        const index_t i = begin_of(j, N_t, is_first);
        double *area = group->area + 2 * j * LANES, *slides = group->slides + j * LANES;
        if (sampled && separate)
            sampled_separate_step(group, j, w, slides, group->slipped.each);
        else if (sampled)
            sampled_circle_step(group, j, w, slides, group->slipped.each);
        else if (separate)
            separate_step(group, i, j, (lanes *)w, (lanes *)area, (lanes *)slides, &group->slipped.all);
        else
            circle_step(group, i, j, (lanes *)w, (lanes *)area, (lanes *)slides, &group->slipped.all);
        memcpy(group->slider + 2 * j * LANES, w, 2 * LANES * sizeof(double));
    }
}

/* State of the search for the cycle of one lane: PLAIN marches without further jumps, AT_CORNER has reached its cycle. */
enum { NO_PERIOD, ONE_PERIOD, JUMPED, PLAIN, AT_CORNER };

typedef struct {
    int stage;                                      /* one of these values */
    double share;                                   /* fraction of the jump in the current trial */
    double at[2], change[2];                        /* slider at the start of a period, and its change in this period */
    double from[2], jump[2];                        /* slider after this period, and the jump from there */
} search;

/* Move the slider w of a lane by its jump, after a period from w - c to w. */
INLINED void begin_jump(search *s, const double *c, double *w)
{
    for (int a = 0; a < 2; a++) {
        s->at[a] = w[a * LANES] - c[a * LANES];
        s->change[a] = c[a * LANES];
        s->from[a] = w[a * LANES];
        w[a * LANES] += s->jump[a];
    }
    s->share = 1.0;
    s->stage = JUMPED;
}

/* Accelerate the convergence of the slider w of a lane, after a period from w - c to w.
 *
 * A period contracts sliders in a single direction with a rate below one, since slip retains only the angle of r.  In this
 * direction the secant through the changes of two periods gives the cycle.  A jump to a cycle without slip, of which there are
 * many, is too long, since a slider drifts to the first of them; it is repeated with half its length, eq. (3.7). */
INLINED void accelerate(search *s, const double *c, int slipped, double *w)
{
    const double at[2] = {w[0] - c[0], w[LANES] - c[LANES]}, size = c[0] * c[0] + c[LANES] * c[LANES];
    const double size_before = s->change[0] * s->change[0] + s->change[1] * s->change[1];
    if (s->stage == JUMPED && (!slipped || size > size_before)) {
        s->share = s->share < 0.02 ? 0.0 : 0.5 * s->share;
        s->stage = s->share > 0.0 ? JUMPED : PLAIN;
        for (int a = 0; a < 2; a++)
            w[a * LANES] = s->from[a] + s->share * s->jump[a];
        return;
    }
    const int may_jump = slipped && (s->stage == ONE_PERIOD || s->stage == JUMPED);
    const double dw[2] = {at[0] - s->at[0], at[1] - s->at[1]}, dc[2] = {c[0] - s->change[0], c[LANES] - s->change[1]};
    const double to[2] = {dw[0] + dc[0], dw[1] + dc[1]}, square = dc[0] * dc[0] + dc[1] * dc[1];
    for (int a = 0; a < 2; a++) {
        s->at[a] = at[a];
        s->change[a] = c[a * LANES];
        s->from[a] = w[a * LANES];
    }
    s->stage = s->stage == PLAIN ? PLAIN : ONE_PERIOD;
    const double moved = dw[0] * dw[0] + dw[1] * dw[1], slowest = 1.0 - SLOWEST;
    if (!may_jump || !(square > slowest * slowest * moved) || !(dw[0] * dc[0] + dw[1] * dc[1] < 0.0))
        return;
    const double along = (c[0] * dc[0] + c[LANES] * dc[1]) / square;
    for (int a = 0; a < 2; a++)
        s->jump[a] = -along * to[a];
    begin_jump(s, c, w);
}

/* The sample of lane l with the largest excess g = |u - w| - rho about w, and its d; with a direction ``against``, only among the
 * samples that push against it. */
INLINED index_t farthest(const aft_group *group, index_t N_t, int l, const double *w, const double *against, double *g,
                            double *d)
{
    index_t sample = -1;
    for (index_t j = 0; j < N_t; j++) {
        const double x = group->du[3 * j * LANES + l] - w[0], y = group->du[(3 * j + 1) * LANES + l] - w[1];
        const double size = sqrt(x * x + y * y), beyond = size - group->rho[j * LANES + l];
        if ((sample >= 0 && !(beyond > *g)) || !(size > 0.0) || (against && !(x * against[0] + y * against[1] < 0.0)))
            continue;
        sample = j;
        *g = beyond;
        d[0] = x / size;
        d[1] = y / size;
    }
    return sample;
}

/* The limit position of a slider that is pushed back and forth: the corner of the region in which no sample moves it, with
 * g = 0 at two samples, eq. (3.7).  Newton's method from w; returns 0 if there is no such region and hence no corner. */
INLINED int find_corner(const aft_group *group, index_t N_t, int l, double tolerance, double *w, index_t *corner)
{
    double to[2] = {w[0], w[LANES]}, d_1[2], d_2[2], g_1, g_2;
    for (int i = 0; i < 40; i++) {
        const index_t j_1 = farthest(group, N_t, l, to, NULL, &g_1, d_1);
        const index_t j_2 = j_1 < 0 ? -1 : farthest(group, N_t, l, to, d_1, &g_2, d_2);
        const double det = d_1[0] * d_2[1] - d_1[1] * d_2[0];
        if (j_2 < 0 || !(fabs(det) > 1e-6))
            return 0;
        if (g_1 <= tolerance && fabs(g_2) <= tolerance) {
            w[0] = to[0];
            w[LANES] = to[1];
            corner[0] = j_1;
            corner[1] = j_2;
            return 1;
        }
        to[0] += (g_1 * d_2[1] - g_2 * d_1[1]) / det;
        to[1] += (g_2 * d_1[0] - g_1 * d_2[0]) / det;
    }
    return 0;
}

/* The position at the start of a period of a slider that two samples push back and forth along the line through both, which are
 * farther apart than the sum of their limits: the cycle that they have by themselves.  Returns 0 if no two samples do so. */
INLINED int find_line(const aft_group *group, index_t N_t, int l, double *w)
{
    double to[2] = {w[0], w[LANES]}, d_1[2], d_2[2], g_1, g_2;
    index_t first = -1, last = -1;
    for (int i = 0; i < 8; i++) {
        const index_t j_1 = farthest(group, N_t, l, to, NULL, &g_1, d_1);
        const index_t j_2 = j_1 < 0 ? -1 : farthest(group, N_t, l, to, d_1, &g_2, d_2);
        if (j_2 < 0)
            return 0;
        if (first == (j_1 < j_2 ? j_1 : j_2) && last == (j_1 < j_2 ? j_2 : j_1)) {
            w[0] = to[0];
            w[LANES] = to[1];
            return 1;
        }
        first = j_1 < j_2 ? j_1 : j_2;
        last = j_1 < j_2 ? j_2 : j_1;
        const double *u = group->du + 3 * last * LANES + l, *v = group->du + 3 * first * LANES + l;
        const double x = u[0] - v[0], y = u[LANES] - v[LANES], size = sqrt(x * x + y * y), rho = group->rho[last * LANES + l];
        if (!(size > rho + group->rho[first * LANES + l]))
            return 0;
        to[0] = u[0] - rho * x / size;
        to[1] = u[LANES] - rho * y / size;
    }
    return 0;
}

INLINED int find_newton_step(aft_group *group, index_t N_t, int l, int separate, int sampled, const double c[2], double step[2]);

typedef struct {                                    /* a pair whose cycle is not reached yet */
    index_t pair, place;                            /* its number, and its number among the active pairs */
    double w[2];
    int periods;                                    /* marched so far */
    int has_jumped, slides_on;                      /* whether it jumped; whether it has not reached its cycle */
    int was_on_line;                                /* whether the cycle of two samples was tried */
    search search;
    index_t corner[2];                              /* the samples that hold it */
} unsettled_pair;

/* End a period that moved the slider of lane l from group->before to w: detect a steady cycle, or choose where to go on. */
INLINED void end_period(aft_group *group, index_t N_t, int l, int separate, int sampled, double tolerance, unsettled_pair *pair, double *w)
{
    const double c[LANES + 1] = {[0] = w[l] - group->before[l], [LANES] = w[LANES + l] - group->before[LANES + l]};
    const double change = fabs(c[0]) + fabs(c[LANES]);
    const int slipped = group->slipped.each[l] > 0.0, stopped = pair->has_jumped && !slipped;
    pair->slides_on = 0;
    if (pair->search.stage == AT_CORNER)
        group->slipped.each[l] = 0.0;                   /* slip at a corner is roundoff */
    else if (change > tolerance || stopped) {
        pair->slides_on = 1;
        if (pair->periods < MOST_PERIODS) {
            if ((stopped || pair->periods % CORNER_AFTER == 0) && find_corner(group, N_t, l, tolerance, w + l, pair->corner))
                pair->search.stage = AT_CORNER;
            else if (!pair->was_on_line && pair->periods % CORNER_AFTER == 0 && find_line(group, N_t, l, w + l)) {
                pair->was_on_line = 1;
                pair->search.stage = NO_PERIOD;
            } else if (slipped && pair->periods >= NEWTON_AFTER && pair->periods % CORNER_AFTER == 0
                       && find_newton_step(group, N_t, l, separate, sampled, (const double[2]){c[0], c[LANES]}, pair->search.jump))
                begin_jump(&pair->search, c, w + l);
            else if (change > tolerance || pair->search.stage == JUMPED)
                accelerate(&pair->search, c, slipped, w + l);
            else
                pair->slides_on = pair->has_jumped = 0;
            pair->has_jumped |= pair->search.stage == JUMPED;
        }
    }
    if (!pair->slides_on) {                             /* so that further periods for the other lanes repeat this one bitwise */
        w[l] = group->before[l];
        w[LANES + l] = group->before[LANES + l];
    }
    group->at_corner[l] = pair->search.stage == AT_CORNER;
    group->corners[2 * l] = pair->corner[0];
    group->corners[2 * l + 1] = pair->corner[1];
}

/* A round of periods from w0, eq. (3.5), or from the end of the last round, until all pairs have a steady cycle, eq. (3.7). */
INLINED void march(aft_group *group, index_t N_t, int separate, int sampled, unsettled_pair *pairs)
{
    double w[2 * LANES] __attribute__((aligned(sizeof(lanes)))), tolerance[LANES] = {0.0};
    int any_slides = 1;
    for (int l = 0; l < LANES; l++) {
        w[l] = pairs[l].w[0];
        w[LANES + l] = pairs[l].w[1];
        group->at_corner[l] = 0;
    }
    for (index_t j = 0; j < N_t; j++)
        for (int l = 0; l < LANES; l++) {
            const double size = fabs(group->du[3 * j * LANES + l]) + fabs(group->du[(3 * j + 1) * LANES + l]);
            const double least = SETTLED * group->rho[j * LANES + l] + ROUNDING * size;
            tolerance[l] = least > tolerance[l] ? least : tolerance[l];
        }
    for (int n = 0; n < ROUND && any_slides && pairs[0].periods < MOST_PERIODS; n++) {
        const int is_first = pairs[0].periods == 0;
        march_period(group, N_t, separate, sampled, is_first, w);
        any_slides = 0;
        for (int l = 0; l < LANES; l++) {
            pairs[l].periods++;
            if (is_first)
                pairs[l].slides_on = N_t > 1;
            else
                end_period(group, N_t, l, separate, sampled, tolerance[l], pairs + l, w);
            any_slides |= pairs[l].slides_on;
        }
    }
    for (int l = 0; l < LANES; l++) {
        pairs[l].w[0] = w[l];
        pairs[l].w[1] = w[LANES + l];
    }
}

/* Half the difference of the mean of min(N, 0) over a step from the mean of its end values: not 0 if N changes its sign. */
INLINED lanes half_dip(lanes N_i, lanes N_j)
{
    const lanes zero = {0.0}, product = size_of(N_i * N_j), distance = size_of(N_i - N_j);
    const mask crosses = ((N_i > 0.0) ^ (N_j > 0.0)) & (distance > 0.0);
    return pick(crosses, 0.25 * product / pick(crosses, distance, zero + 1.0), zero);
}

/* p at the samples, eq. (3.2) and eq. (3.4); half the area of a step is added at each of its ends, eq. (6.4). */
INLINED void find_forces(aft_group *group, index_t N_t, int sampled)
{
    const lanes zero = {0.0}, N0 = row(group->N0, 0), k_t = row(group->k_t, 0), k_n = row(group->k_n, 0);
    const lanes preload = pick(N0 > 0.0, N0, zero), closing = pick(N0 < 0.0, -N0, zero);     /* normal force needed to close a gap */
    mask ever_open = {0};
    for (index_t j = 0; j < N_t; j++)
        ever_open |= ~(row(group->N, j) > 0.0);
    const int some_open = any(ever_open);
    *(lanes *)group->opened = pick(ever_open, zero + 1.0, zero);
    for (index_t j = 0; j < N_t; j++) {
        const index_t i = j > 0 ? j - 1 : N_t - 1, k = j + 1 < N_t ? j + 1 : 0;
        lanes *force = (lanes *)(group->force + 3 * j * LANES);
        force[2] = closing;
        for (int a = 0; a < 2; a++) {
            lanes w = row(group->slider, 2 * j + a);
            if (!sampled)
                w += 0.5 * (row(group->area, 2 * j + a) + row(group->area, 2 * k + a));
            force[a] = -k_t * w;
        }
        if (some_open) {
            const lanes N = row(group->N, j), open_force = preload - k_n * row(group->du, 3 * j + 2);
            force[2] = pick(N > 0.0, closing, open_force);
            if (!sampled)
                force[2] += half_dip(row(group->N, i), N) + half_dip(N, row(group->N, k));
        }
    }
}

/* The harmonics of p from its samples, eq. (6.1). */
INLINED void project(aft_group *group, const aft_tables *t)
{
    memset(group->p, 0, (size_t)(3 * t->N_H * LANES) * sizeof(double));
    add_product(group->p, t->F, group->force, t->N_t, t->N_H, t->stride, 3 * LANES);
}

/* ---- derivatives ------------------------------------------------------------------------------------------------ */

enum { INPUTS = 8 };                                /* of a step: w_x, w_y, u_x, u_y, N at its start, u_x, u_y, N at its end */
typedef double gradient __attribute__((vector_size(INPUTS * sizeof(double))));

typedef struct {                                    /* a value with its derivatives by the inputs of a step */
    gradient g;
    double v;
} dual;

INLINED dual constant(double v)
{
    return (dual){.v = v};
}

INLINED dual input(double v, int k, double slope)
{
    dual c = constant(v);
    c.g[k] = slope;
    return c;
}

INLINED dual plus(dual a, double f, dual b)         /* a + f b */
{
    return (dual){a.g + f * b.g, a.v + f * b.v};
}

INLINED dual times(dual a, dual b)
{
    return (dual){a.g * b.v + a.v * b.g, a.v * b.v};
}

INLINED dual scaled(double f, dual a)
{
    return (dual){f * a.g, f * a.v};
}

INLINED dual over(dual a, dual b)
{
    const double inverse = 1.0 / b.v, v = a.v * inverse;
    return (dual){(a.g - v * b.g) * inverse, v};
}

INLINED dual root_of(dual a)                        /* derivative 0 at 0 */
{
    const double size = sqrt(a.v > 0.0 ? a.v : 0.0), slope = size > 0.0 ? 0.5 / size : 0.0;
    return (dual){slope * a.g, size};
}

INLINED dual product(dual a_x, dual a_y, dual b_x, dual b_y)
{
    return plus(times(a_x, b_x), 1.0, times(a_y, b_y));
}

struct step_map_of {                                /* (n) after a step: w; over it: its area; by the inputs, u_z for N */
    double A[2][2], C_i[2][3], C_j[2][3];
};

typedef struct step_map {
    double w[2];
    struct step_map_of slider, area;
    int has_area;
} step_map;

typedef struct {                                    /* a step of one lane, with derivatives */
    dual w[2], u_i[2], u_j[2], N_i, N_j, rho_i, rho_j, s_0, s_1;
    int free_i, free_j;
} lane_step;

INLINED lane_step step_of(const aft_group *group, index_t i, index_t j, int l, const double *w)
{
    lane_step s;
    for (int a = 0; a < 2; a++) {
        s.w[a] = input(w[a], a, 1.0);
        s.u_i[a] = input(group->du[(3 * i + a) * LANES + l], 2 + a, 1.0);
        s.u_j[a] = input(group->du[(3 * j + a) * LANES + l], 5 + a, 1.0);
    }
    s.N_i = input(group->N[i * LANES + l], 4, -group->k_n[l]);      /* derivatives by u_z */
    s.N_j = input(group->N[j * LANES + l], 7, -group->k_n[l]);
    s.free_i = !(group->rho[i * LANES + l] > 0.0);
    s.free_j = !(group->rho[j * LANES + l] > 0.0);
    s.rho_i = s.free_i ? constant(0.0) : scaled(group->give[l], s.N_i);
    s.rho_j = s.free_j ? constant(0.0) : scaled(group->give[l], s.N_j);
    s.s_0 = constant(0.0);
    s.s_1 = constant(1.0);
    if (s.free_i != s.free_j)
        *(s.free_i ? &s.s_0 : &s.s_1) = over(s.N_i, plus(s.N_i, -1.0, s.N_j));
    return s;
}

INLINED dual dual_area(dual s_0, dual sigma, dual s_1, dual w_i, dual w_a, dual w_b, dual w_j)
{
    dual sum = times(s_0, plus(w_i, 1.0, w_a));
    sum = plus(sum, 1.0, times(plus(s_1, -1.0, sigma), plus(w_a, 1.0, w_b)));
    sum = plus(sum, 1.0, times(plus(constant(1.0), -1.0, s_1), plus(w_b, 1.0, w_j)));
    sum = plus(plus(sum, -1.0, w_i), -1.0, w_j);
    return plus(scaled(0.5, sum), 1.0, times(plus(sigma, -1.0, s_0), w_a));
}

INLINED void store(struct step_map_of *to, int a, dual value)
{
    for (int b = 0; b < 2; b++)
        to->A[a][b] = value.g[b];
    for (int b = 0; b < 3; b++) {
        to->C_i[a][b] = value.g[2 + b];
        to->C_j[a][b] = value.g[5 + b];
    }
}

/* circle_step, eq. (3.6), for one lane that slides or is free somewhere in the step. */
INLINED void circle_map(const lane_step *s, step_map *m)
{
    dual a[2], b[2], w[2], V[2], r[2], d[2], q[2], to[2], end[2];
    const int is_free = s->free_i && s->free_j;
    for (int k = 0; k < 2; k++) {
        const dual v = plus(s->u_j[k], -1.0, s->u_i[k]);
        a[k] = s->free_i && !is_free ? plus(s->u_i[k], 1.0, times(s->s_0, v)) : s->u_i[k];
        b[k] = s->free_j && !is_free ? plus(s->u_i[k], 1.0, times(s->s_1, v)) : s->u_j[k];
        w[k] = s->free_i ? a[k] : s->w[k];
        V[k] = plus(b[k], -1.0, a[k]);
        r[k] = plus(a[k], -1.0, w[k]);
    }
    const dual rho = s->rho_i, rho_j = s->rho_j, d_rho = plus(rho_j, -1.0, rho);
    const double x = b[0].v - w[0].v, y = b[1].v - w[1].v;
    const int slips = !is_free && x * x + y * y > rho_j.v * rho_j.v;
    dual sigma = constant(0.0);
    if (slips) {
        dual c = plus(product(r[0], r[1], r[0], r[1]), -1.0, times(rho, rho));
        const dual B = plus(product(r[0], r[1], V[0], V[1]), -1.0, times(rho, d_rho));
        const dual A = plus(product(V[0], V[1], V[0], V[1]), -1.0, times(d_rho, d_rho));
        const double on = ON_LIMIT * rho.v * rho.v;
        c.v = c.v < 0.0 ? c.v : 0.0;                /* remove roundoff */
        if (!(B.v > 0.0 ? c.v >= -on : A.v <= 0.0) && !s->free_i) {
            const dual S = root_of(plus(times(B, B), -1.0, times(A, c)));
            sigma = B.v > 0.0 ? over(scaled(-1.0, c), plus(B, 1.0, S)) : over(plus(S, -1.0, B), A);
            sigma = sigma.v < 1.0 ? sigma : constant(1.0);
        }
        const dual rest = plus(constant(1.0), -1.0, sigma), rho_s = plus(rho, 1.0, times(sigma, d_rho));
        for (int k = 0; k < 2; k++) {
            q[k] = times(rest, V[k]);
            d[k] = plus(r[k], 1.0, times(sigma, V[k]));
        }
        const dual chord = root_of(product(q[0], q[1], q[0], q[1]));
        const dual size = root_of(product(d[0], d[1], d[0], d[1]));
        for (int k = 0; k < 2; k++)
            d[k] = size.v > 0.0 ? over(d[k], size) : chord.v > 0.0 ? over(q[k], chord) : constant(0.0);
        const dual p = scaled(0.5, plus(rho_s, 1.0, rho_j)), half = plus(p, 0.5, chord), pp = times(p, p);
        const dual Y = plus(pp, 1.0, times(chord, half)), Y_pp = plus(Y, 1.0, pp), dq = times(product(d[0], d[1], q[0], q[1]), half);
        const dual den = plus(plus(times(Y, Y), 1.0, times(pp, pp)), 1.0, times(dq, Y_pp));
        if (den.v > 0.0) {
            const dual turn = over(times(half, plus(Y_pp, 1.0, dq)), den), stays = over(scaled(2.0, times(Y, pp)), den);
            for (int k = 0; k < 2; k++)
                d[k] = plus(times(stays, d[k]), 1.0, times(turn, q[k]));
        }
    }
    const dual from = slips ? plus(s->s_0, 1.0, times(sigma, plus(s->s_1, -1.0, s->s_0))) : s->s_1;
    m->has_area = !is_free && (sigma.v > 0.0 || s->free_i || s->free_j);
    for (int k = 0; k < 2; k++) {
        to[k] = slips ? plus(b[k], -1.0, times(rho_j, d[k])) : w[k];
        end[k] = s->free_j ? s->u_j[k] : to[k];
        m->w[k] = end[k].v;
        store(&m->slider, k, end[k]);
        if (m->has_area)
            store(&m->area, k, dual_area(s->s_0, from, s->s_1, s->w[k], w[k], to[k], end[k]));
    }
}

/* separate_step for one lane. */
INLINED void separate_map(const lane_step *s, step_map *m)
{
    const int is_free = s->free_i && s->free_j;
    m->has_area = 0;
    for (int k = 0; k < 2; k++) {
        const dual v = plus(s->u_j[k], -1.0, s->u_i[k]);
        const dual a = s->free_i && !is_free ? plus(s->u_i[k], 1.0, times(s->s_0, v)) : s->u_i[k];
        const dual b = s->free_j && !is_free ? plus(s->u_i[k], 1.0, times(s->s_1, v)) : s->u_j[k];
        const dual w = s->free_i ? a : s->w[k], r = plus(b, -1.0, w);
        const double sign = r.v < 0.0 ? -1.0 : 1.0;
        const dual excess = plus(scaled(sign, r), -1.0, s->rho_j);
        const dual before = plus(scaled(sign, plus(a, -1.0, w)), -1.0, s->rho_i);
        const int slips = !is_free && excess.v > 0.0;
        dual sigma = constant(0.0);
        if (slips && before.v < -ON_LIMIT * s->rho_i.v)
            sigma = over(before, plus(before, -1.0, excess));
        const dual from = slips ? plus(s->s_0, 1.0, times(sigma, plus(s->s_1, -1.0, s->s_0))) : s->s_1;
        const dual to = slips ? plus(b, -sign, s->rho_j) : w, end = s->free_j ? s->u_j[k] : to;
        m->w[k] = end.v;
        store(&m->slider, k, end);
        store(&m->area, k, is_free ? constant(0.0) : dual_area(s->s_0, from, s->s_1, s->w[k], w, to, end));
        m->has_area |= !is_free && (sigma.v > 0.0 || s->free_i || s->free_j);
    }
}

/* The return map for one lane, eq. (6.2). */
INLINED void sampled_map(const lane_step *s, int separate, step_map *m)
{
    const dual x = plus(s->u_j[0], -1.0, s->w[0]), y = plus(s->u_j[1], -1.0, s->w[1]), length = root_of(product(x, y, x, y));
    m->has_area = 0;
    for (int k = 0; k < 2; k++) {
        const dual r = k == 0 ? x : y, size = separate ? scaled(r.v < 0.0 ? -1.0 : 1.0, r) : length;
        dual end = s->w[k];
        if (s->free_j)
            end = s->u_j[k];
        else if (size.v > s->rho_j.v)
            end = plus(s->u_j[k], -1.0, times(s->rho_j, over(r, size)));
        m->w[k] = end.v;
        store(&m->slider, k, end);
    }
}

typedef double slopes __attribute__((vector_size(4 * sizeof(double))));    /* by q_p, q_n and p below; one is not used */

/* circle_map for the usual step, which slides from start to end, closed.  Writes w and the slider's map; returns 0 for any
 * other step.  With d = r / |r|, its normal n and the motion q = q_p d + q_n n in the step, eq. (3.6) is d' = T_p d + T_n n,
 * where T_p and T_n depend only on q_p, q_n and the mean p of the slip distances. */
INLINED int sliding_map(const aft_group *group, index_t i, index_t j, int l, const double *w, step_map *m)
{
    const double *u_i = group->du + 3 * i * LANES + l, *u_j = group->du + 3 * j * LANES + l;
    const double rho_i = group->rho[i * LANES + l], rho = group->rho[j * LANES + l], d_rho = rho - rho_i;
    const double r_x = u_i[0] - w[0], r_y = u_i[LANES] - w[1], q_x = u_j[0] - u_i[0], q_y = u_j[LANES] - u_i[LANES];
    const double x = r_x + q_x, y = r_y + q_y, square = r_x * r_x + r_y * r_y, b = r_x * q_x + r_y * q_y - rho_i * d_rho;
    const int at_once = b > 0.0 ? square - rho_i * rho_i >= -ON_LIMIT * rho_i * rho_i : q_x * q_x + q_y * q_y <= d_rho * d_rho;
    if (!(rho_i > 0.0 && rho > 0.0 && x * x + y * y > rho * rho && at_once && square > 0.0))
        return 0;
    const double per_size = 1.0 / sqrt(square), d[2] = {r_x * per_size, r_y * per_size}, n[2] = {-d[1], d[0]};
    const double q_p = d[0] * q_x + d[1] * q_y, q_n = n[0] * q_x + n[1] * q_y, p = 0.5 * (rho_i + rho), pp = p * p;
    const double chord = sqrt(q_x * q_x + q_y * q_y), per_chord = chord > 0.0 ? 1.0 / chord : 0.0, half = p + 0.5 * chord;
    const double Y = pp + chord * half, Y_pp = Y + pp, dq = q_p * half, den = Y * Y + pp * pp + dq * Y_pp;
    if (!(den > 0.0))
        return 0;
    const slopes by_q_p = {1.0}, by_q_n = {0.0, 1.0}, by_p = {0.0, 0.0, 1.0}, chord_by = {q_p * per_chord, q_n * per_chord};
    const slopes half_by = by_p + 0.5 * chord_by, pp_by = 2.0 * p * by_p, Y_by = pp_by + half * chord_by + chord * half_by;
    const slopes Y_pp_by = Y_by + pp_by, dq_by = half * by_q_p + q_p * half_by;
    const slopes den_by = 2.0 * (Y * Y_by + pp * pp_by) + Y_pp * dq_by + dq * Y_pp_by;
    const double per_den = 1.0 / den, turn = half * (Y_pp + dq) * per_den, stays = 2.0 * Y * pp * per_den;
    const slopes turn_by = ((Y_pp + dq) * half_by + half * (Y_pp_by + dq_by) - turn * den_by) * per_den;
    const slopes stays_by = (2.0 * (pp * Y_by + Y * pp_by) - stays * den_by) * per_den;
    const double T_p = stays + turn * q_p, T_n = turn * q_n, slope = -group->give[l] * group->k_n[l];
    const slopes T_p_by = stays_by + q_p * turn_by + turn * by_q_p, T_n_by = q_n * turn_by + turn * by_q_n;
    /* d rotates with r, by n . dr / |r|, and changes q_p and q_n */
    const double p_by_angle = T_p_by[0] * q_n - T_p_by[1] * q_p - T_n, n_by_angle = T_n_by[0] * q_n - T_n_by[1] * q_p + T_p;
    m->has_area = 0;
    for (int a = 0; a < 2; a++) {
        const double t = T_p * d[a] + T_n * n[a], by_angle = (p_by_angle * d[a] + n_by_angle * n[a]) * per_size;
        const double by_mean = 0.5 * slope * rho * (T_p_by[2] * d[a] + T_n_by[2] * n[a]);
        const double along = T_p_by[0] * d[a] + T_n_by[0] * n[a], across = T_p_by[1] * d[a] + T_n_by[1] * n[a];
        m->w[a] = u_j[a * LANES] - rho * t;
        for (int c = 0; c < 2; c++) {
            const double by_r = rho * by_angle * n[c], by_q = rho * (along * d[c] + across * n[c]);
            m->slider.A[a][c] = by_r;
            m->slider.C_i[a][c] = by_q - by_r;
            m->slider.C_j[a][c] = (a == c) - by_q;
        }
        m->slider.C_i[a][2] = -by_mean;
        m->slider.C_j[a][2] = -by_mean - slope * t;
    }
    return 1;
}

INLINED void map_of(const aft_group *group, index_t i, index_t j, int l, const double *w, int separate, int sampled,
                    step_map *m)
{
    if (!sampled && !separate && sliding_map(group, i, j, l, w, m))
        return;
    const lane_step s = step_of(group, i, j, l, w);
    if (sampled)
        sampled_map(&s, separate, m);
    else if (separate)
        separate_map(&s, m);
    else
        circle_map(&s, m);
}

/* W after a slip, or the derivative of an area with its map; e_i and e_j are rows of E.  ``after`` may be ``before``. */
INLINED void apply_map(double *after, const double *before, const struct step_map_of *m, const double *e_i, const double *e_j,
                       index_t stride)
{
    for (int b = 0; b < 3; b++) {
        const double *x = before + b * stride, *y = before + (3 + b) * stride;
        double *to_x = after + b * stride, *to_y = after + (3 + b) * stride;
        const double xx = m->A[0][0], xy = m->A[0][1], yx = m->A[1][0], yy = m->A[1][1];
        const double x_i = m->C_i[0][b], y_i = m->C_i[1][b], x_j = m->C_j[0][b], y_j = m->C_j[1][b];
#pragma GCC ivdep
        for (index_t h = 0; h < stride; h++) {
            const double old_x = x[h], old_y = y[h];
            to_x[h] = xx * old_x + xy * old_y + x_i * e_i[h] + x_j * e_j[h];
            to_y[h] = yx * old_x + yy * old_y + y_i * e_i[h] + y_j * e_j[h];
        }
    }
}

/* Whether the slider of a lane moves in a step. */
INLINED int moves(const aft_group *group, index_t i, index_t j, int l, int separate, int sampled, const double *w)
{
    const double x = group->du[3 * j * LANES + l] - w[0], y = group->du[(3 * j + 1) * LANES + l] - w[1];
    const double rho_i = group->rho[i * LANES + l], rho = group->rho[j * LANES + l];
    const int inside = separate ? fabs(x) <= rho && fabs(y) <= rho : x * x + y * y <= rho * rho;
    return !(inside && rho > 0.0 && (rho_i > 0.0 || sampled));
}

/* The maps of the slips of the last period for one lane; returns their number. */
INLINED index_t find_maps(aft_group *group, index_t N_t, int l, int separate, int sampled)
{
    index_t n = 0;
    for (index_t j = 0; j < N_t && !group->at_corner[l]; j++) {
        if (!(group->slides[j * LANES + l] > 0.0))
            continue;
        const index_t i = j > 0 ? j - 1 : N_t - 1;
        const double *before = j > 0 ? group->slider + 2 * i * LANES : group->before;
        const double w[2] = {before[l], before[LANES + l]};
        map_of(group, i, j, l, w, separate, sampled, group->maps + n);
        group->events[n++] = j;
    }
    return n;
}

/* W of a lane whose final position depends on its path: a march from w0 with derivatives, until a period without slip. */
INLINED void march_with_derivative(const aft_group *group, const aft_tables *t, int l, int separate, int sampled, double *W)
{
    const index_t N_t = t->N_t, stride = t->stride;
    double w[2] = {0.0, 0.0};
    int slides = 1;
    memset(W, 0, (size_t)(6 * stride) * sizeof(double));
    for (int period = 0; period < MOST_PERIODS && slides; period++) {
        slides = period == 0;
        for (index_t j = period == 0 && sampled; j < N_t; j++) {
            const index_t i = begin_of(j, N_t, period == 0);
            if (!moves(group, i, j, l, separate, sampled, w))
                continue;
            step_map m;
            map_of(group, i, j, l, w, separate, sampled, &m);
            const double moved = fabs(m.w[0] - w[0]) + fabs(m.w[1] - w[1]);
            const double *u = group->du + 3 * j * LANES + l;
            slides |= moved > MOVES * (fabs(u[0]) + fabs(u[LANES]) + fabs(w[0]) + fabs(w[1]));
            apply_map(W, W, &m.slider, t->E + i * stride, t->E + j * stride, stride);
            memcpy(w, m.w, sizeof w);
        }
    }
}

/* M = dw/dw of n maps in turn, and its largest entry; returns the first of them that has an effect. */
INLINED index_t of_period(const aft_group *group, index_t n, double M[2][2], double *largest)
{
    index_t first = n;
    M[0][0] = M[1][1] = *largest = 1.0;
    M[0][1] = M[1][0] = 0.0;
    while (first > 0 && *largest > FORGOTTEN) {
        const double (*A)[2] = group->maps[--first].slider.A;
        *largest = 0.0;
        for (int a = 0; a < 2; a++) {
            const double x = M[a][0], y = M[a][1];
            for (int b = 0; b < 2; b++) {
                M[a][b] = x * A[0][b] + y * A[1][b];
                *largest = fabs(M[a][b]) > *largest ? fabs(M[a][b]) : *largest;
            }
        }
    }
    return first;
}

/* The step of Newton's method for eq. (3.7) from the end of a period that moved the slider of lane l by c, M (1 - M)^-1 c; returns 0
 * where 1 - M has no inverse. */
INLINED int find_newton_step(aft_group *group, index_t N_t, int l, int separate, int sampled, const double c[2], double step[2])
{
    double M[2][2], largest;
    of_period(group, find_maps(group, N_t, l, separate, sampled), M, &largest);
    const double xx = 1.0 - M[0][0], yy = 1.0 - M[1][1], det = xx * yy - M[0][1] * M[1][0];
    if (!(fabs(det) > 1.0 - SLOWEST))
        return 0;
    step[0] = (yy * c[0] + M[0][1] * c[1]) / det - c[0];
    step[1] = (M[1][0] * c[0] + xx * c[1]) / det - c[1];
    return 1;
}

/* W of the steady cycle of n maps, W = A W + C, eq. (6.5); returns 0, without W, if it is not unique. */
INLINED int find_fixed_point(const aft_group *group, const aft_tables *t, index_t n, double *W)
{
    const index_t stride = t->stride;
    double M[2][2], largest;
    const index_t first = of_period(group, n, M, &largest);
    const double xx = 1.0 - M[0][0], yy = 1.0 - M[1][1], det = xx * yy - M[0][1] * M[1][0];
    if (!(fabs(det) > 1.0 - SLOWEST))
        return 0;
    for (index_t k = first; k < n; k++) {
        const index_t j = group->events[k], i = j > 0 ? j - 1 : t->N_t - 1;
        apply_map(W, W, &group->maps[k].slider, t->E + i * stride, t->E + j * stride, stride);
    }
    for (index_t c = 0; c < 3 * stride && largest > FORGOTTEN; c++) {
        const double C_x = W[c], C_y = W[3 * stride + c];
        W[c] = (yy * C_x + M[0][1] * C_y) / det;
        W[3 * stride + c] = (M[1][0] * C_x + xx * C_y) / det;
    }
    return 1;
}

/* W of a slider held by two samples, d . dw = d . du - d rho at both. */
INLINED void corner_derivative(const aft_group *group, const aft_tables *t, int l, double *W)
{
    const index_t stride = t->stride;
    double d[2][2];
    for (int k = 0; k < 2; k++) {
        const double *u = group->du + 3 * group->corners[2 * l + k] * LANES + l;
        const double x = u[0] - group->before[l], y = u[LANES] - group->before[LANES + l], size = sqrt(x * x + y * y);
        d[k][0] = x / size;
        d[k][1] = y / size;
    }
    const double det = d[0][0] * d[1][1] - d[0][1] * d[1][0];
    for (int k = 0; k < 2; k++) {
        const double *e = t->E + group->corners[2 * l + k] * stride;
        const double by[3] = {d[k][0], d[k][1], group->give[l] * group->k_n[l]};
        const double to_x = (k == 0 ? d[1][1] : -d[0][1]) / det, to_y = (k == 0 ? -d[1][0] : d[0][0]) / det;
        for (int b = 0; b < 3; b++)
            for (index_t h = 0; h < stride; h++) {
                W[b * stride + h] += to_x * by[b] * e[h];
                W[(3 + b) * stride + h] += to_y * by[b] * e[h];
            }
    }
}

/* W at the start of the last period with n maps: of the steady cycle, of a corner, or of the path. */
INLINED void find_start(aft_group *group, const aft_tables *t, index_t n, int l, int separate, int sampled, double *W)
{
    memset(W, 0, (size_t)(6 * t->stride) * sizeof(double));
    if (t->N_t == 1 || (n == 0 && group->before[l] == 0.0 && group->before[LANES + l] == 0.0))
        return;
    if (group->slipped.each[l] > 0.0 && find_fixed_point(group, t, n, W))
        return;
    if (group->at_corner[l]) {
        corner_derivative(group, t, l, W);
        return;
    }
    march_with_derivative(group, t, l, separate, sampled, W);
}

/* group->sum = sum over the last period of F (x) W, and of the areas' derivatives, for lane l. */
INLINED void sum_slider_derivative(aft_group *group, const aft_tables *t, int l, int separate, int sampled)
{
    const index_t N_t = t->N_t, stride = t->stride, width = 6 * stride;
    const index_t n_events = find_maps(group, N_t, l, separate, sampled);
    double *before = group->W, *W = group->W + width;       /* row 0 has the last W of the previous chunk */
    const double *last = before;
    find_start(group, t, n_events, l, separate, sampled, before);
    memset(group->sum, 0, (size_t)(t->N_H * width) * sizeof(double));
    index_t n = 0, next = n_events > 0 ? group->events[0] : N_t;
    if (next > 0) {                                         /* until the first slip */
        memcpy(W, before, (size_t)width * sizeof(double));
        memcpy(group->G, t->S + next * stride, (size_t)stride * sizeof(double));
        n = 1;
    }
    for (index_t k = 0; k < n_events; k++) {
        const index_t j = group->events[k], i = j > 0 ? j - 1 : N_t - 1;
        const double *e_i = t->E + i * stride, *e_j = t->E + j * stride, *F_i = t->F + i * stride, *F_j = t->F + j * stride;
        next = k + 1 < n_events ? group->events[k + 1] : N_t;
        if (group->maps[k].has_area) {
            apply_map(W + n * width, last, &group->maps[k].area, e_i, e_j, stride);
            for (index_t c = 0; c < stride; c++)
                group->G[n * stride + c] = 0.5 * (F_i[c] + F_j[c]);
            n++;
        }
        apply_map(W + n * width, last, &group->maps[k].slider, e_i, e_j, stride);
        last = W + n * width;
        for (index_t c = 0; c < stride; c++)
            group->G[n * stride + c] = next == j + 1 ? F_j[c] : t->S[next * stride + c] - t->S[j * stride + c];
        if (++n >= CHUNK - 1) {
            add_product(group->sum, group->G, W, n, t->N_H, stride, width);
            memcpy(before, last, (size_t)width * sizeof(double));
            last = before;
            n = 0;
        }
    }
    add_product(group->sum, group->G, W, n, t->N_H, stride, width);
}

/* group->sum = derivative by u_z of the loss of normal force of lane l by opening: sum over open samples of F (x) E, and dips. */
INLINED void sum_opening_derivative(aft_group *group, const aft_tables *t, int l, int sampled)
{
    const index_t N_t = t->N_t, stride = t->stride;
    index_t n = 0;
    memset(group->sum, 0, (size_t)(t->N_H * stride) * sizeof(double));
    for (index_t j = 0; j < N_t; j++) {
        const index_t i = j > 0 ? j - 1 : N_t - 1;
        const double N_i = group->N[i * LANES + l], N_j = group->N[j * LANES + l], size = N_i - N_j;
        if (!(N_j > 0.0)) {
            memcpy(group->G + n * stride, t->F + j * stride, (size_t)stride * sizeof(double));
            memcpy(group->W + n * stride, t->E + j * stride, (size_t)stride * sizeof(double));
            n++;
        }
        if (!sampled && (N_i > 0.0) != (N_j > 0.0) && size != 0.0) {
            const double by_i = (N_i > 0.0 ? 0.5 : -0.5) * (N_j / size) * (N_j / size);
            const double by_j = (N_j > 0.0 ? 0.5 : -0.5) * (N_i / size) * (N_i / size);
            for (index_t c = 0; c < stride; c++) {
                group->G[n * stride + c] = 0.5 * (t->F[i * stride + c] + t->F[j * stride + c]);
                group->W[n * stride + c] = by_i * t->E[i * stride + c] + by_j * t->E[j * stride + c];
            }
            n++;
        }
        if (n >= CHUNK - 1) {
            add_product(group->sum, group->G, group->W, n, t->N_H, stride, stride);
            n = 0;
        }
    }
    add_product(group->sum, group->G, group->W, n, t->N_H, stride, stride);
}

/* P of lane l, (3 N_H, 3 N_H).  The normal force does not depend on the tangential motion. */
INLINED void differentiate(aft_group *group, const aft_tables *t, int l, int separate, int sampled, double *P)
{
    const index_t N_H = t->N_H, stride = t->stride, width = 6 * stride;
    sum_slider_derivative(group, t, l, separate, sampled);
    for (int a = 0; a < 2; a++)
        for (index_t c = 0; c < N_H; c++)
            for (int b = 0; b < 3; b++)
                for (index_t h = 0; h < N_H; h++)
                    P[(a * N_H + c) * 3 * N_H + b * N_H + h] =
                        0.0 - group->k_t[l] * group->sum[c * width + (3 * a + b) * stride + h];
    double *P_z = P + 6 * N_H * N_H;
    memset(P_z, 0, (size_t)(3 * N_H * N_H) * sizeof(double));
    if (!(group->opened[l] > 0.0))
        return;
    sum_opening_derivative(group, t, l, sampled);
    for (index_t c = 0; c < N_H; c++)
        for (index_t h = 0; h < N_H; h++)
            P_z[c * 3 * N_H + 2 * N_H + h] = -group->k_n[l] * group->sum[c * stride + h];
}

/* ---- entry points ----------------------------------------------------------------------------------------------- */

static int allocate(aft_group *group, const aft_tables *t)
{
    const size_t N_H = (size_t)t->N_H, N_t = (size_t)t->N_t, s = (size_t)t->stride;
    const size_t sizes[] = {3 * N_H * LANES, 3 * N_t * LANES, N_t * LANES, N_t * LANES, N_t * LANES, 3 * N_t * LANES, 2 * N_t * LANES,
                            2 * N_t * LANES, N_t * LANES, 3 * N_H * LANES, (CHUNK + 1) * 6 * s, CHUNK * s, 6 * N_H * s};
    double **arrays[] = {&group->U, &group->du, &group->rho, &group->per_rho, &group->N, &group->force, &group->slider,
                         &group->area, &group->slides, &group->p, &group->W, &group->G, &group->sum};
    const int n_arrays = sizeof sizes / sizeof sizes[0];
    size_t total = 0;
    for (int i = 0; i < n_arrays; i++)
        total += sizes[i] * sizeof(double);
    void *block;                                    /* rows of lanes do not straddle cache lines */
    if (posix_memalign(&block, LANES * sizeof(double), total + N_t * (sizeof(step_map) + sizeof(index_t))) != 0)
        return -1;
    double *memory = block;
    for (int i = 0; i < n_arrays; i++) {
        *arrays[i] = memory;
        memory += sizes[i];
    }
    group->maps = (step_map *)memory;
    group->events = (index_t *)(group->maps + N_t);
    return 0;
}

INLINED int is_finite(const aft_pairs *pairs, index_t i, index_t N_H)
{
    double zero = 0.0 * (pairs->mu[i] + pairs->N0[i] + pairs->k_t[i] + pairs->k_n[i]);
    zero += 0.0 * pairs->w0[2 * i] + 0.0 * pairs->w0[2 * i + 1];
    for (index_t c = 0; c < 3 * N_H; c++)
        zero += 0.0 * pairs->U[3 * N_H * i + c];
    return zero == 0.0;
}

/* leaves[i] = 0 if pair i sticks, closed, at every sample, so that p and dp/dU vanish.  Returns -1 without memory. */
int KERNEL(aft_leaves)(const aft_tables *t, const aft_pairs *pairs, index_t n, unsigned char *leaves)
{
    aft_group group;
    index_t undecided[LANES];
    int n_lanes = 0;
    if (allocate(&group, t) != 0)
        return -1;
    for (index_t i = 0; i < n; i++) {
        leaves[i] = 0;
        if (!surely_stuck(pairs, i, t->N_H))
            undecided[n_lanes++] = i;
        if (n_lanes > 0 && (n_lanes == LANES || i + 1 == n)) {
            for (int l = n_lanes; l < LANES; l++)
                undecided[l] = undecided[0];
            test_samples(&group, pairs, t, undecided, n_lanes, leaves);
            n_lanes = 0;
        }
    }
    free(group.U);
    return 0;
}

/* A round for some pairs; writes the results of pairs with a steady cycle, or at MOST_PERIODS. */
INLINED void march_round(aft_group *group, const aft_tables *t, const aft_pairs *pairs, unsettled_pair *lane, int n_lanes, int separate,
                         double *p, unsigned char *state, unsigned char *drifts, double *P)
{
    const index_t size = 3 * t->N_H;
    const int sampled = t->sampled && t->N_t > 1;   /* a constant motion has no path */
    index_t chosen[LANES];
    for (int l = 0; l < LANES; l++)
        chosen[l] = lane[l].pair;
    gather(group, pairs, chosen, t->N_H);
    sample(group, t);
    march(group, t->N_t, separate, sampled, lane);
    find_forces(group, t->N_t, sampled);
    project(group, t);
    for (int l = 0; l < n_lanes; l++) {
        if (lane[l].slides_on && lane[l].periods < MOST_PERIODS)
            continue;
        const int finite = is_finite(pairs, chosen[l], t->N_H);
        double *P_l = P == NULL ? NULL : P + size * size * lane[l].place;
        state[chosen[l]] = group->opened[l] > 0.0 ? OPEN : group->slipped.each[l] > 0.0 ? SLIP : STICK;
        drifts[chosen[l]] = lane[l].slides_on;
        for (index_t c = 0; c < size; c++)
            p[size * chosen[l] + c] = finite ? group->p[(c % t->N_H * 3 + c / t->N_H) * LANES + l] : NAN;
        if (P_l != NULL && finite)
            differentiate(group, t, l, separate, sampled, P_l);
        for (index_t c = 0; P_l != NULL && !finite && c < size * size; c++)
            P_l[c] = NAN;
        lane[l].slides_on = 0;
    }
}

/* March the m active pairs: writes their rows of p (n, 3, N_H), state and drifts (n,), and all of P (m, 3 N_H, 3 N_H) unless it
 * is NULL.  Pairs with a friction circle and with separate limits form different groups.  Returns -1 without memory. */
int KERNEL(aft_march)(const aft_tables *t, const aft_pairs *pairs, index_t m, const index_t *active, double *p,
              unsigned char *state, unsigned char *drifts, double *P)
{
    aft_group group;
    unsettled_pair lane[LANES], *waiting = calloc((size_t)m, sizeof *waiting);
    if (waiting == NULL || allocate(&group, t) != 0) {
        free(waiting);
        return -1;
    }
    for (int separate = 0; separate < 2; separate++) {
        index_t n_waiting = 0;
        for (index_t k = 0; k < m; k++)
            if ((pairs->separate[active[k]] != 0) == separate)
                waiting[n_waiting++] = (unsettled_pair){.pair = active[k], .place = k};
        while (n_waiting > 0) {
            index_t n_left = 0;
            for (index_t k = 0; k < n_waiting; k += LANES) {
                const int n_lanes = n_waiting - k < LANES ? (int)(n_waiting - k) : LANES;
                for (int l = 0; l < LANES; l++)
                    lane[l] = waiting[k + (l < n_lanes ? l : 0)];
                march_round(&group, t, pairs, lane, n_lanes, separate, p, state, drifts, P);
                for (int l = 0; l < n_lanes; l++)
                    if (lane[l].slides_on)
                        waiting[n_left++] = lane[l];
            }
            n_waiting = n_left;
        }
    }
    free(group.U);
    free(waiting);
    return 0;
}

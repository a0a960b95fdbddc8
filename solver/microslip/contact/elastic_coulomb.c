/* Contact forces over sampled periods and their exact derivatives: the compiled part of elastic_coulomb.py, included by
 * _elastic_coulomb.pyx.
 *
 * The law of docs/theory.md, section 3, marched through two periods of which the second is kept.  Motion du_t and slider
 * position w are both measured from the slider's start w0, so that w = 0 at first, T = k_t (du_t - w) and p_t = -k_t w.  With the
 * slip distance rho = mu N / k_t and r = du_t - w, (3.3) is:
 *
 *     circle     |r| <= rho: stick;   else  alpha = rho / |r|,  d = r / |r|,  w <- du_t - alpha r
 *     separate   the same for each direction by itself
 *
 * rho = 0 (open, or mu = 0) is free sliding: w <- du_t whatever r is, so that T and its derivative vanish.
 *
 * The derivative W = dw/dU, (6.2), has rows x, y and the columns of U_x, U_y, U_z.  A slip at sample j does, with row e of E,
 *
 *     W <- A W + [I - A, d mu k_n / k_t] (x) e,      circle A = alpha (I - d d^T);   separate A = diag(1 if it stays)
 *
 * and W stays as it is while the pair sticks.  So dp_t/dU = -k_t sum over slips of (sum of F until the next) (x) W,
 * a product of two thin matrices with one row a slip.
 *
 * Coefficients run [mean if there is one, then cos and sin of each harmonic]: there is a mean exactly if N_H is odd.  Which
 * harmonics they are, E and F alone know.
 *
 * LANES pairs are marched side by side; arrays of samples keep the lane as their last index.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* One copy of the kernel for each kind of processor, chosen when the module is loaded. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && !defined(__INTEL_COMPILER)
#if __GNUC__ >= 12
#define EVERY_MACHINE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define EVERY_MACHINE __attribute__((target_clones("avx512f", "avx2", "default")))
#endif
#else
#define EVERY_MACHINE
#endif
#if defined(__GNUC__)
#define INLINED static inline __attribute__((always_inline))
#else
#define INLINED static inline
#endif

enum { LANES = 8 };                                 /* pairs side by side */
enum { CHUNK = 32 };                                /* slips that a matrix product takes at once */
enum { STICK = 0, SLIP = 1, OPEN = 2 };
static const double NO_SLIP = -1.0;                 /* in place of alpha */
static const double FORGOTTEN = 1e-20;              /* share of an older W that is below roundoff */
static const double MOVES = 1e-14;                  /* relative slider step that is more than roundoff */

typedef struct {
    Py_ssize_t N_H, N_t;
    Py_ssize_t stride;                              /* N_H rounded up to a multiple of 4; padded with zeros */
    const double *E;                                /* (N_t, stride) rows of the synthesis matrix */
    const double *E_T;                              /* (N_H, N_t) its columns */
    const double *F;                                /* (N_t, stride) columns of the analysis matrix */
    const double *S;                                /* (N_t + 1, stride) their running sums, S_0 = 0 */
} aft_tables;

typedef struct {
    const double *mu, *N0, *k_t, *k_n;              /* (n,) */
    const unsigned char *separate;                  /* (n,) */
    const double *w0;                               /* (n, 2) the sliders' start */
    const double *U;                                /* (n, 3, N_H) */
} aft_pairs;

typedef struct {                                    /* one group of LANES pairs */
    double N0[LANES], k_t[LANES], k_n[LANES];
    double give[LANES];                             /* mu / k_t, slip distance per normal force */
    double start[3 * LANES];                        /* du less the sliders' start where the pair is at rest */
    double *U;                                      /* (N_H, 3, LANES) */
    double *du;                                     /* (N_t, 3, LANES) less the sliders' start */
    double *rho;                                    /* (N_t, LANES) slip distance; infinite where k_t = 0 */
    double *closed;                                 /* (N_t, LANES) 1 where N > 0, else 0 */
    double *force;                                  /* (N_t, 3, LANES) p at the samples of the kept period */
    double *slips;                                  /* (2 N_t, 3, LANES) alpha, d of both periods; NO_SLIP: stick */
    double slipped[LANES], opened[LANES];           /* in the kept period */
    double *p;                                      /* (N_H, 3, LANES) */
    Py_ssize_t *events;                             /* (2 N_t,) samples of both periods at which one pair slips */
    double *W;                                      /* (CHUNK + 1, 2, 3, stride) */
    double *G;                                      /* (CHUNK, stride) */
    double *sum;                                    /* (N_H, 2, 3, stride) */
} aft_group;

/* ---- matrix products -------------------------------------------------------------------------------------------- */

/* add_product for a fixed number of rows: each pass over sum takes them all. */
INLINED void add_rows(double *restrict sum, const double *G, const double *W, const int n, Py_ssize_t n_out,
                      Py_ssize_t stride, const Py_ssize_t width)
{
    for (Py_ssize_t i = 0; i < n_out; i++) {
        double *restrict to = sum + i * width;
        for (Py_ssize_t q = 0; q < width; q++) {
            double value = to[q];
            for (int k = 0; k < n; k++)
                value += G[k * stride + i] * W[k * width + q];
            to[q] = value;
        }
    }
}

/* sum += G^T W over n rows: sum (n_out, width), G (n, stride) of which the first n_out columns count, W (n, width). */
INLINED void add_product(double *sum, const double *G, const double *W, Py_ssize_t n, Py_ssize_t n_out,
                         Py_ssize_t stride, const Py_ssize_t width)
{
    Py_ssize_t k = 0;
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

INLINED void gather(aft_group *group, const aft_pairs *pairs, const Py_ssize_t *chosen, Py_ssize_t N_H)
{
    for (int l = 0; l < LANES; l++) {
        const Py_ssize_t i = chosen[l];
        const double *U = pairs->U + 3 * N_H * i;
        group->N0[l] = pairs->N0[i];
        group->k_t[l] = pairs->k_t[i];
        group->k_n[l] = pairs->k_n[i];
        group->give[l] = pairs->k_t[i] > 0.0 ? pairs->mu[i] / pairs->k_t[i] : 0.0;
        group->start[l] = 0.0 - pairs->w0[2 * i];
        group->start[LANES + l] = 0.0 - pairs->w0[2 * i + 1];
        group->start[2 * LANES + l] = 0.0;
        for (int a = 0; a < 3; a++)
            for (Py_ssize_t h = 0; h < N_H; h++)
                group->U[(3 * h + a) * LANES + l] = U[a * N_H + h];
    }
}

/* The motion at the samples; of the normal force, eq. (3.1), what the sliders feel: whether there is any, and rho. */
INLINED void sample(aft_group *group, const aft_tables *t)
{
    for (Py_ssize_t j = 0; j < t->N_t; j++)
        for (int c = 0; c < 3 * LANES; c++)
            group->du[3 * j * LANES + c] = group->start[c];
    add_product(group->du, t->E_T, group->U, t->N_H, t->N_t, t->N_t, 3 * LANES);
    for (Py_ssize_t j = 0; j < t->N_t; j++)
        for (int l = 0; l < LANES; l++) {
            const double N = group->N0[l] - group->k_n[l] * group->du[(3 * j + 2) * LANES + l];
            const double rho = N > 0.0 ? group->give[l] * N : 0.0;
            group->closed[j * LANES + l] = N > 0.0 ? 1.0 : 0.0;
            group->rho[j * LANES + l] = group->k_t[l] > 0.0 ? rho : INFINITY;
        }
}

/* ---- which pairs leave sticking --------------------------------------------------------------------------------- */

INLINED double mean_of(const double *U, Py_ssize_t N_H)
{
    return N_H % 2 ? U[0] : 0.0;
}

/* No sample is further from the mean. */
INLINED double amplitude_bound(const double *U, Py_ssize_t N_H)
{
    double bound = 0.0;
    for (Py_ssize_t h = N_H % 2; h < N_H; h += 2)
        bound += sqrt(U[h] * U[h] + U[h + 1] * U[h + 1]);
    return bound;
}

/* True if even all harmonics peaking together leave the pair stuck and closed: most pairs of a quiet joint end here. */
INLINED int surely_stuck(const aft_pairs *pairs, Py_ssize_t i, Py_ssize_t N_H)
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

INLINED void test_samples(aft_group *group, const aft_pairs *pairs, const aft_tables *t, const Py_ssize_t *chosen,
                          int n_lanes, unsigned char *leaves)
{
    gather(group, pairs, chosen, t->N_H);
    sample(group, t);
    for (int l = 0; l < n_lanes; l++) {
        int stays = group->N0[l] >= 0.0;
        const int separate = pairs->separate[chosen[l]];
        for (Py_ssize_t j = 0; stays && j < t->N_t; j++) {
            const double *du = group->du + 3 * j * LANES + l, rho = group->rho[j * LANES + l];
            const double x = du[0], y = du[LANES];
            const int inside = separate ? fabs(x) <= rho && fabs(y) <= rho : x * x + y * y <= rho * rho;
            stays = inside && rho > 0.0 && group->closed[j * LANES + l] > 0.0;
        }
        leaves[chosen[l]] = !stays;
    }
}

/* ---- two periods ------------------------------------------------------------------------------------------------ */

/* One sample on all lanes, eq. (3.3): reads du, rho; moves w; writes alpha, d; marks lanes whose slider really moves. */
INLINED void circle_step(const double *du, const double *rho, double *w, double *slip, double *slipped)
{
    for (int l = 0; l < LANES; l++) {
        const double x = du[l] - w[l], y = du[LANES + l] - w[LANES + l];
        const double square = x * x + y * y, size = sqrt(square);
        const double inverse = 1.0 / (size > 0.0 ? size : 1.0);
        const double alpha = rho[l] * inverse;
        const int is_free = rho[l] == 0.0, slips = (square > rho[l] * rho[l]) | is_free;
        const double roundoff = MOVES * (fabs(du[l]) + fabs(du[LANES + l]) + fabs(w[l]) + fabs(w[LANES + l]));
        slipped[l] = (slips & ((size - rho[l] > roundoff) | is_free)) ? 1.0 : slipped[l];
        slip[l] = slips ? alpha : NO_SLIP;
        slip[LANES + l] = x * inverse;
        slip[2 * LANES + l] = y * inverse;
        w[l] = slips ? du[l] - alpha * x : w[l];
        w[LANES + l] = slips ? du[LANES + l] - alpha * y : w[LANES + l];
    }
}

/* The same for separate limits; d is the sign of the slip in each direction, 0 where that direction sticks. */
INLINED void separate_step(const double *du, const double *rho, double *w, double *slip, double *slipped)
{
    for (int l = 0; l < LANES; l++) {
        const int is_free = rho[l] == 0.0;
        slip[l] = NO_SLIP;
        for (int a = 0; a < 2; a++) {
            const double r = du[a * LANES + l] - w[a * LANES + l], size = fabs(r);
            const double sign = r < 0.0 ? -1.0 : 1.0;
            const int slips = (size > rho[l]) | is_free;
            const double roundoff = MOVES * (fabs(du[a * LANES + l]) + fabs(w[a * LANES + l]));
            slipped[l] = (slips & ((size - rho[l] > roundoff) | is_free)) ? 1.0 : slipped[l];
            slip[l] = slips ? 0.0 : slip[l];
            slip[(a + 1) * LANES + l] = slips ? sign : 0.0;
            w[a * LANES + l] = slips ? du[a * LANES + l] - sign * rho[l] : w[a * LANES + l];
        }
    }
}

/* Both periods on all lanes, from w0 on, eq. (3.5); forces of the kept one, eq. (3.2) and eq. (3.4). */
INLINED void march(aft_group *group, Py_ssize_t N_t, int separate)
{
    double w[2 * LANES] = {0.0}, slipped[LANES], opened[LANES] = {0.0}, preload[LANES], closing[LANES];
    for (int l = 0; l < LANES; l++) {
        group->slips[l] = NO_SLIP;                  /* the first sample is taken as it is, with w = w0 */
        preload[l] = group->N0[l] > 0.0 ? group->N0[l] : 0.0;
        closing[l] = group->N0[l] < 0.0 ? -group->N0[l] : 0.0;      /* the preload that closing an initial gap takes */
    }
    for (int period = 0; period < 2; period++) {
        memset(slipped, 0, sizeof slipped);
        for (Py_ssize_t j = period == 0; j < N_t; j++) {
            const double *du = group->du + 3 * j * LANES, *rho = group->rho + j * LANES;
            double *slip = group->slips + 3 * (period * N_t + j) * LANES;
            if (separate)
                separate_step(du, rho, w, slip, slipped);
            else
                circle_step(du, rho, w, slip, slipped);
            for (int l = 0; l < LANES; l++) {
                double *force = group->force + 3 * j * LANES + l;
                const int closed = group->closed[j * LANES + l] > 0.0;
                force[0] = -group->k_t[l] * w[l];
                force[LANES] = -group->k_t[l] * w[LANES + l];
                force[2 * LANES] = closed ? closing[l] : preload[l] - group->k_n[l] * du[2 * LANES + l];
                opened[l] = closed ? opened[l] : 1.0;
            }
        }
    }
    memcpy(group->slipped, slipped, sizeof slipped);
    memcpy(group->opened, opened, sizeof opened);
}

/* The samples of p on the harmonics, eq. (6.1). */
INLINED void project(aft_group *group, const aft_tables *t)
{
    memset(group->p, 0, (size_t)(3 * t->N_H * LANES) * sizeof(double));
    add_product(group->p, t->F, group->force, t->N_t, t->N_H, t->stride, 3 * LANES);
}

/* ---- derivatives ------------------------------------------------------------------------------------------------ */

typedef struct {
    double A[2][2];
    double C[2][3];                                 /* [I - A, d mu k_n / k_t] */
} slip_map;

/* How a slip changes W, eq. (6.2). */
INLINED slip_map map_of(const aft_group *group, Py_ssize_t k, int l, Py_ssize_t N_t, int separate)
{
    const double *slip = group->slips + 3 * k * LANES + l;
    const double alpha = slip[0], d[2] = {slip[LANES], slip[2 * LANES]};
    const double grip = group->closed[(k < N_t ? k : k - N_t) * LANES + l] * group->give[l] * group->k_n[l];
    slip_map m;
    m.A[0][0] = separate ? (d[0] == 0.0) : alpha * d[1] * d[1];
    m.A[1][1] = separate ? (d[1] == 0.0) : alpha * d[0] * d[0];
    m.A[0][1] = m.A[1][0] = separate ? 0.0 : -alpha * d[0] * d[1];
    for (int a = 0; a < 2; a++) {
        for (int b = 0; b < 2; b++)
            m.C[a][b] = (a == b) - m.A[a][b];
        m.C[a][2] = d[a] * grip;
    }
    return m;
}

/* W after a slip; may be the same array as before. */
INLINED void move_slider(double *after, const double *before, const slip_map *m, const double *e, Py_ssize_t stride)
{
    for (int b = 0; b < 3; b++) {
        const double *x = before + b * stride, *y = before + (3 + b) * stride;
        double *to_x = after + b * stride, *to_y = after + (3 + b) * stride;
        const double xx = m->A[0][0], xy = m->A[0][1], yy = m->A[1][1], x_new = m->C[0][b], y_new = m->C[1][b];
#pragma GCC ivdep
        for (Py_ssize_t h = 0; h < stride; h++) {
            const double old_x = x[h], old_y = y[h];
            to_x[h] = xx * old_x + xy * old_y + x_new * e[h];
            to_y[h] = xy * old_x + yy * old_y + y_new * e[h];
        }
    }
}

/* First slip of period one that still matters in period two: what lies before it has been forgotten. */
INLINED Py_ssize_t first_that_matters(const aft_group *group, Py_ssize_t n_before, int l, Py_ssize_t N_t, int separate)
{
    double M[2][2] = {{1.0, 0.0}, {0.0, 1.0}}, largest = 1.0;
    Py_ssize_t i = n_before;
    while (i > 0 && largest > FORGOTTEN) {
        const slip_map m = map_of(group, group->events[--i], l, N_t, separate);
        largest = 0.0;
        for (int a = 0; a < 2; a++) {
            const double x = M[a][0], y = M[a][1];
            for (int b = 0; b < 2; b++) {
                M[a][b] = x * m.A[0][b] + y * m.A[1][b];
                largest = fabs(M[a][b]) > largest ? fabs(M[a][b]) : largest;
            }
        }
    }
    return i;
}

/* group->sum = sum over the kept period of F (x) W for lane l. */
INLINED void sum_slider_derivative(aft_group *group, const aft_tables *t, int l, int separate)
{
    const Py_ssize_t N_t = t->N_t, stride = t->stride, width = 6 * stride;
    Py_ssize_t n_events = 0, n_before = 0;
    for (Py_ssize_t k = 0; k < 2 * N_t; k++) {
        n_before = k == N_t ? n_events : n_before;
        group->events[n_events] = k;
        n_events += group->slips[3 * k * LANES + l] != NO_SLIP;
    }
    double *before = group->W, *W = group->W + width;       /* row 0 of W keeps the last state */
    memset(before, 0, (size_t)width * sizeof(double));
    memset(group->sum, 0, (size_t)(t->N_H * width) * sizeof(double));
    for (Py_ssize_t i = first_that_matters(group, n_before, l, N_t, separate); i < n_before; i++) {
        const slip_map m = map_of(group, group->events[i], l, N_t, separate);
        move_slider(before, before, &m, t->E + group->events[i] * stride, stride);
    }
    Py_ssize_t n = 0, next = n_before < n_events ? group->events[n_before] - N_t : N_t;
    if (n_before > 0 && next > 0) {                         /* until the first slip of the kept period */
        memcpy(W, before, (size_t)width * sizeof(double));
        memcpy(group->G, t->S + next * stride, (size_t)stride * sizeof(double));
        n = 1;
    }
    for (Py_ssize_t i = n_before; i < n_events; i++) {
        const Py_ssize_t j = group->events[i] - N_t;
        const slip_map m = map_of(group, group->events[i], l, N_t, separate);
        next = i + 1 < n_events ? group->events[i + 1] - N_t : N_t;
        move_slider(W + n * width, before + n * width, &m, t->E + j * stride, stride);
        for (Py_ssize_t c = 0; c < stride; c++)
            group->G[n * stride + c] =
                next == j + 1 ? t->F[j * stride + c] : t->S[next * stride + c] - t->S[j * stride + c];
        if (++n == CHUNK) {
            add_product(group->sum, group->G, W, n, t->N_H, stride, width);
            memcpy(before, W + (n - 1) * width, (size_t)width * sizeof(double));
            n = 0;
        }
    }
    add_product(group->sum, group->G, W, n, t->N_H, stride, width);
}

/* P of lane l, (3 N_H, 3 N_H).  The normal force does not know the tangential motion. */
INLINED void differentiate(aft_group *group, const aft_tables *t, int l, int separate, double *P)
{
    const Py_ssize_t N_H = t->N_H, N_t = t->N_t, stride = t->stride, width = 6 * stride;
    sum_slider_derivative(group, t, l, separate);
    for (int a = 0; a < 2; a++)
        for (Py_ssize_t c = 0; c < N_H; c++)
            for (int b = 0; b < 3; b++)
                for (Py_ssize_t h = 0; h < N_H; h++)
                    P[(a * N_H + c) * 3 * N_H + b * N_H + h] =
                        0.0 - group->k_t[l] * group->sum[c * width + (3 * a + b) * stride + h];
    double *P_z = P + 6 * N_H * N_H;
    memset(P_z, 0, (size_t)(3 * N_H * N_H) * sizeof(double));
    if (!(group->opened[l] > 0.0))
        return;
    memset(group->sum, 0, (size_t)(N_H * stride) * sizeof(double));
    Py_ssize_t n = 0;
    for (Py_ssize_t j = 0; j < N_t; j++) {
        if (group->closed[j * LANES + l] > 0.0)
            continue;
        memcpy(group->G + n * stride, t->F + j * stride, (size_t)stride * sizeof(double));
        memcpy(group->W + n * stride, t->E + j * stride, (size_t)stride * sizeof(double));
        if (++n == CHUNK) {
            add_product(group->sum, group->G, group->W, n, N_H, stride, stride);
            n = 0;
        }
    }
    add_product(group->sum, group->G, group->W, n, N_H, stride, stride);
    for (Py_ssize_t c = 0; c < N_H; c++)
        for (Py_ssize_t h = 0; h < N_H; h++)
            P_z[c * 3 * N_H + 2 * N_H + h] = -group->k_n[l] * group->sum[c * stride + h];
}

/* ---- entry points ----------------------------------------------------------------------------------------------- */

static int allocate(aft_group *group, const aft_tables *t)
{
    const size_t N_H = (size_t)t->N_H, N_t = (size_t)t->N_t, s = (size_t)t->stride;
    const size_t sizes[] = {3 * N_H * LANES, 3 * N_t * LANES, N_t * LANES, N_t * LANES, 3 * N_t * LANES,
                            6 * N_t * LANES, 3 * N_H * LANES, (CHUNK + 1) * 6 * s, CHUNK * s, 6 * N_H * s};
    double **arrays[] = {&group->U, &group->du, &group->rho, &group->closed, &group->force, &group->slips,
                         &group->p, &group->W, &group->G, &group->sum};
    size_t total = 0;
    for (int i = 0; i < 10; i++)
        total += sizes[i];
    void *block;                                    /* rows of lanes do not straddle cache lines */
    if (posix_memalign(&block, LANES * sizeof(double), total * sizeof(double) + 2 * N_t * sizeof(Py_ssize_t)) != 0)
        return -1;
    double *memory = block;
    for (int i = 0; i < 10; i++) {
        *arrays[i] = memory;
        memory += sizes[i];
    }
    group->events = (Py_ssize_t *)memory;
    return 0;
}

INLINED int is_finite(const aft_pairs *pairs, Py_ssize_t i, Py_ssize_t N_H)
{
    double zero = 0.0 * (pairs->mu[i] + pairs->N0[i] + pairs->k_t[i] + pairs->k_n[i]);
    zero += 0.0 * pairs->w0[2 * i] + 0.0 * pairs->w0[2 * i + 1];
    for (Py_ssize_t c = 0; c < 3 * N_H; c++)
        zero += 0.0 * pairs->U[3 * N_H * i + c];
    return zero == 0.0;
}

/* leaves[i] = 0 if pair i sticks, closed, at every sample, so that p and dp/dU vanish.  Returns -1 without memory. */
EVERY_MACHINE
int aft_leaves(const aft_tables *t, const aft_pairs *pairs, Py_ssize_t n, unsigned char *leaves)
{
    aft_group group;
    Py_ssize_t undecided[LANES];
    int n_lanes = 0;
    if (allocate(&group, t) != 0)
        return -1;
    for (Py_ssize_t i = 0; i < n; i++) {
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

INLINED void finish(aft_group *group, const aft_tables *t, const aft_pairs *pairs, const Py_ssize_t *chosen,
                    const Py_ssize_t *place, int n_lanes, int separate, double *p, unsigned char *state, double *P)
{
    const Py_ssize_t size = 3 * t->N_H;
    gather(group, pairs, chosen, t->N_H);
    sample(group, t);
    march(group, t->N_t, separate);
    project(group, t);
    for (int l = 0; l < n_lanes; l++) {
        const int finite = is_finite(pairs, chosen[l], t->N_H);
        double *P_l = P == NULL ? NULL : P + size * size * place[l];
        state[chosen[l]] = group->opened[l] > 0.0 ? OPEN : group->slipped[l] > 0.0 ? SLIP : STICK;
        for (Py_ssize_t c = 0; c < size; c++)
            p[size * chosen[l] + c] = finite ? group->p[(c % t->N_H * 3 + c / t->N_H) * LANES + l] : NAN;
        if (P_l != NULL && finite)
            differentiate(group, t, l, separate, P_l);
        for (Py_ssize_t c = 0; P_l != NULL && !finite && c < size * size; c++)
            P_l[c] = NAN;
    }
}

/* March the m active pairs: writes their rows of p (n, 3, N_H) and state (n,), and all of P (m, 3 N_H, 3 N_H) unless it
 * is NULL.  Pairs with a friction circle and with separate limits are grouped apart.  Returns -1 without memory. */
EVERY_MACHINE
int aft_march(const aft_tables *t, const aft_pairs *pairs, Py_ssize_t m, const Py_ssize_t *active, double *p,
              unsigned char *state, double *P)
{
    aft_group group;
    if (allocate(&group, t) != 0)
        return -1;
    for (int separate = 0; separate < 2; separate++) {
        Py_ssize_t chosen[LANES], place[LANES];
        int n_lanes = 0;
        for (Py_ssize_t k = 0; k < m; k++) {
            if ((pairs->separate[active[k]] != 0) == separate) {
                chosen[n_lanes] = active[k];
                place[n_lanes++] = k;
            }
            if (n_lanes > 0 && (n_lanes == LANES || k + 1 == m)) {
                for (int l = n_lanes; l < LANES; l++)
                    chosen[l] = chosen[0];
                finish(&group, t, pairs, chosen, place, n_lanes, separate, p, state, P);
                n_lanes = 0;
            }
        }
    }
    free(group.U);
    return 0;
}

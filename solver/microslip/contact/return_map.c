/* A time step of two Jenkins elements and a normal spring, directly from docs/theory.md, section 3.

   It has no code in common with elastic_coulomb.c, which marches over cycles, as time integration verifies harmonic balance. */
#include <math.h>
#include <string.h>

#include "return_map.h"

enum { STICK, SLIP, OPEN };

/* dp/du (3, 3) [N/m] of a step, eq. (6.2); zero where the pair sticks.
   slides, t and alpha = mu N / |T_pred| have values for x and y; mu_kn = mu k_n is 0 where the pair is open. */
static void step_derivative(const double k[2], const int slides[2], int separate, const double t[2], const double alpha[2],
                            const double mu_kn[2], double L[9])
{
    for (int i = 0; i < 2; i++) {
        if (!slides[i])
            continue;
        const double turn = separate ? 0.0 : alpha[i] * k[i];
        for (int j = 0; j < 2; j++)
            L[3 * i + j] = turn * ((i == j) - t[i] * t[j]);
        L[4 * i] -= k[i];
        L[3 * i + 2] = -mu_kn[i] * t[i];
    }
}

/* The i-th pair: p (3,) [N], dp/du (9,) unless L is NULL, and state after a step to du (3,) [m] from the tangential p before (2,)
   [N]. */
static inline void return_step(const spring_pairs *pairs, index_t i, const double du[3], const double before[2], double p[3],
                        double L[9], unsigned char *state)
{
    const double *k = pairs->k_t + 2 * i, *mu = pairs->mu + 2 * i, *w0 = pairs->w0 + 2 * i;
    const double N0 = pairs->N0[i], k_n = pairs->k_n[i], closing = N0 - k_n * du[2];
    const int is_open = closing <= 0.0, separate = pairs->separate[i];
    const double N = is_open ? 0.0 : closing;
    double stuck[2], T[2], t[2] = {0.0, 0.0}, alpha[2] = {0.0, 0.0}, mu_kn[2] = {0.0, 0.0}; /* the last three where it slides */
    int slides[2];
    for (int d = 0; d < 2; d++) {
        stuck[d] = k[d] * (du[d] - w0[d]);
        T[d] = stuck[d] + before[d];
    }
    const double length = sqrt(T[0] * T[0] + T[1] * T[1]);
    for (int d = 0; d < 2; d++) {
        const double size = separate ? fabs(T[d]) : length, limit = mu[d] * N, safe = size > 0.0 ? size : 1.0;
        slides[d] = size > limit || (is_open && k[0] > 0.0);
        p[d] = before[d];
        if (slides[d]) {
            t[d] = T[d] / safe;
            alpha[d] = limit / safe;
            mu_kn[d] = is_open ? 0.0 : mu[d] * k_n;
            p[d] = limit * t[d] - stuck[d];
        }
    }
    p[2] = is_open ? (N0 > 0.0 ? N0 : 0.0) - k_n * du[2] : (N0 < 0.0 ? -N0 : 0.0);
    if (L != NULL) {
        memset(L, 0, 9 * sizeof *L);
        step_derivative(k, slides, separate, t, alpha, mu_kn, L);
        if (is_open)
            L[8] = -k_n;
    }
    *state = is_open ? OPEN : slides[0] || slides[1] ? SLIP : STICK;
}

/* All pairs at each of n_points motions: du and p (n_points, n, 3), L (.., 3, 3), state (..); before (n_points, n, stride). */
void return_steps(const spring_pairs *pairs, index_t n_points, const double *du, const double *before, index_t stride, double *p,
                  double *L, unsigned char *state)
{
    for (index_t b = 0; b < n_points; b++)
        for (index_t i = 0; i < pairs->n; i++, du += 3, before += stride, p += 3, L += 9, state++)
            return_step(pairs, i, du, before, p, L, state);
}

#define ROUNDING 1e-10 /* relative to the largest force of the springs: less slip in a period counts as none */

enum { FROM_MEMORY = 4, FROM_MOTION = 6, OF_STEP = FROM_MEMORY + 2 * FROM_MOTION };

/* a = D a for a (2, n) and D (2, 2). */
static void advance(const double D[4], double *a, index_t n)
{
    for (index_t j = 0; j < n; j++) {
        const double x = D[0] * a[j] + D[1] * a[n + j], y = D[2] * a[j] + D[3] * a[n + j];
        a[j] = x;
        a[n + j] = y;
    }
}

/* Adds the derivatives a to their mean over a step and to their mean weighted with the time, with their weights w of both since
   they changed, which become 0. */
static void add_means(double *of_step, const double a[OF_STEP], double w[2])
{
    for (index_t m = 0; m < OF_STEP; m++) {
        of_step[OF_STEP + m] += w[0] * a[m];
        of_step[2 * OF_STEP + m] += w[1] * a[m];
    }
    w[0] = w[1] = 0.0;
}

/* Begin and end of the linear course with this mean and this mean weighted with the time, eq. (16.3), in their place (2, 16). */
static void linear_course(double of_step[2 * OF_STEP])
{
    for (index_t m = 0; m < OF_STEP; m++) {
        const double mean = of_step[m], moment = of_step[OF_STEP + m];
        of_step[m] = 4.0 * mean - 6.0 * moment;
        of_step[OF_STEP + m] = 6.0 * moment - 2.0 * mean;
    }
}

/* Marches the i-th pair from p (2,) [N] through n_t samples du (n_t, 3) [m] of a period, from the second sample to the first
   one of the next period; moves (n_t,) is 1 where p_x has changed, 2 where p_y has and 4 where the pair is open, added up.  Returns
   whether it sticks, or slips only by roundoff where it is exactly at its limit. */
static int follow_period(const spring_pairs *pairs, index_t i, index_t n_t, const double *du, double p[2], unsigned char *moves)
{
    const double *k = pairs->k_t + 2 * i;
    double now[3], moved = 0.0, most = 0.0;
    unsigned char state;
    for (index_t j = 1; j <= n_t; j++) {
        const index_t at = j < n_t ? j : 0;
        const double *there = du + 3 * at;
        return_step(pairs, i, there, p, now, NULL, &state);
        moves[at] = (unsigned char)((now[0] != p[0]) + 2 * (now[1] != p[1]) + 4 * (state == OPEN));
        moved += fabs(now[0] - p[0]) + fabs(now[1] - p[1]);
        most = fmax(most, fabs(k[0] * there[0]) + fabs(k[1] * there[1]));
        p[0] = now[0];
        p[1] = now[1];
    }
    return moved <= ROUNDING * most;
}

/* A part of a step, from the time t to t + width, at whose end the i-th pair is at du (3,) [m]: advances p (2,) [N] and its
   derivatives a by p_t, d0 and d1, eq. (16.2), and adds a to their means, between both ends as linear in time.  by_touch (2,)
   [N/m] is the derivative of p_t by the normal motion through the instant at which the pair comes into contact, otherwise 0. */
static void vary_part(const spring_pairs *pairs, index_t i, const double du[3], const double by_touch[2], double t, double width,
                      double p[2], double a[OF_STEP], double w[2], double *of_step)
{
    const double *k = pairs->k_t + 2 * i, end = t + width;
    double now[3], L[9];
    unsigned char state;
    return_step(pairs, i, du, p, now, L, &state);
    w[0] += 0.5 * width;
    w[1] += width * (0.5 * t + width / 6.0);
    if (state != STICK) { /* otherwise p and its derivatives stay */
        add_means(of_step, a, w);
        p[0] = now[0];
        p[1] = now[1];
        L[2] += by_touch[0];
        L[5] += by_touch[1];
        const double D[4] = {k[0] > 0.0 ? 1.0 + L[0] / k[0] : 1.0, k[1] > 0.0 ? L[1] / k[1] : 0.0,
                             k[0] > 0.0 ? L[3] / k[0] : 0.0, k[1] > 0.0 ? 1.0 + L[4] / k[1] : 1.0};
        advance(D, a, 2);
        advance(D, a + FROM_MEMORY, 3);
        advance(D, a + FROM_MEMORY + FROM_MOTION, 3);
        for (index_t m = 0; m < FROM_MOTION; m++) {
            a[FROM_MEMORY + m] += (1.0 - end) * L[m];
            a[FROM_MEMORY + FROM_MOTION + m] += end * L[m];
        }
    }
    w[0] += 0.5 * width;
    w[1] += width * (0.5 * t + width / 3.0);
}

/* The same for a part in which the motion is a straight line from `from` to `to` (3,) [m].  Where the pair comes into contact the
   part is divided: the slider starts where the pair is at this instant, docs/theory.md after eq. (16.2). */
static void vary_straight(const spring_pairs *pairs, index_t i, const double from[3], const double to[3], double t, double width,
                          double p[2], double a[OF_STEP], double w[2], double *of_step)
{
    const double none[2] = {0.0, 0.0}, *k = pairs->k_t + 2 * i;
    const double N = pairs->N0[i] - pairs->k_n[i] * from[2], N_end = pairs->N0[i] - pairs->k_n[i] * to[2];
    if (N <= 0.0 && N_end > 0.0) {
        const double x = N / (N - N_end), opened = to[2] - from[2];
        double touch[3] = {0.0, 0.0, from[2]}, by_touch[2]; /* open as before */
        for (int d = 0; d < 2; d++) {
            touch[d] = from[d] + x * (to[d] - from[d]);
            by_touch[d] = k[d] * (to[d] - from[d]) / opened;
        }
        vary_part(pairs, i, touch, by_touch, t, x * width, p, a, w, of_step);
        t += x * width;
        width *= 1.0 - x;
    }
    vary_part(pairs, i, to, none, t, width, p, a, w, of_step);
}

/* du (3,) at a share x of the way from the sample before `at` to it: the cubic polynomial through four of n_t samples (n_t, 3). */
static void between(const double *samples, index_t n_t, index_t at, double x, double du[3])
{
    const double c[4] = {-x * (x - 1.0) * (x - 2.0) / 6.0, (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
                         -(x + 1.0) * x * (x - 2.0) / 2.0, (x + 1.0) * x * (x - 1.0) / 6.0};
    for (int d = 0; d < 3; d++) {
        du[d] = 0.0;
        for (index_t j = 0; j < 4; j++)
            du[d] += c[j] * samples[3 * ((at - 2 + j + n_t) % n_t) + d];
    }
}

#define PARTS 16 /* of the way between two samples where a pair begins or ceases to slip, opens or closes */

/* Derivatives of p_t of pairs by p_t and by the motion in each of n_steps steps of a periodic motion: docs/theory.md, section 16.

   The motion of the i-th pair is du[motion[i]] (n_steps n_sub, 3) [m]; slider positions follow from at most most_periods
   periods of it.  Within a step a change of motion is linear, d0 at its start and d1 at its end.  M (n, n_steps, 3, 16) has for
   p_t at the end of a step, and for begin and end of its linear course, the derivatives by p_t at the start (2, 2) [-], by d0 and
   by d1 (2, 3) [N/m]; it comes as zeros.  sticks (n,) is 1, and M stays 0, for a pair that always
   sticks.  moves (n_steps n_sub,) is work space. */
void vary_period(const spring_pairs *pairs, const index_t *motion, index_t n_steps, index_t n_sub, const double *du,
                 index_t most_periods, double *M, unsigned char *sticks, unsigned char *moves)
{
    const index_t n_t = n_steps * n_sub;
    for (index_t i = 0; i < pairs->n; i++, M += 3 * OF_STEP * n_steps) {
        const double *samples = du + 3 * n_t * motion[i];
        double p[2] = {0.0, 0.0}, before[2];
        sticks[i] = 0;
        for (index_t period = 0; period < most_periods; period++) {
            memcpy(before, p, sizeof p);
            sticks[i] = (unsigned char)follow_period(pairs, i, n_t, samples, p, moves);
            if (sticks[i] || hypot(p[0] - before[0], p[1] - before[1]) <= 1e-12 * hypot(p[0], p[1]))
                break;
        }
        if (sticks[i])
            continue;
        double *of_step = M;
        for (index_t step = 0; step < n_steps; step++, of_step += 3 * OF_STEP) {
            double a[OF_STEP] = {1.0, 0.0, 0.0, 1.0}, w[2] = {0.0, 0.0}, from[3], to[3];
            memcpy(from, samples + 3 * step * n_sub, sizeof from);
            for (index_t j = 1; j <= n_sub; j++) {
                const index_t at = step * n_sub + j;
                const index_t end = at < n_t ? at : 0, after = end + 1 < n_t ? end + 1 : 0;
                const index_t n_parts = moves[at - 1] == moves[end] && moves[end] == moves[after] ? 1 : PARTS;
                const double width = 1.0 / (double)(n_sub * n_parts);
                for (index_t part = 1; part <= n_parts; part++) {
                    if (part < n_parts)
                        between(samples, n_t, at, (double)part / (double)n_parts, to);
                    else
                        memcpy(to, samples + 3 * end, sizeof to);
                    vary_straight(pairs, i, from, to, width * (double)((j - 1) * n_parts + part - 1), width, p, a, w, of_step);
                    memcpy(from, to, sizeof from);
                }
            }
            add_means(of_step, a, w);
            linear_course(of_step + OF_STEP);
            memcpy(of_step, a, sizeof a);
        }
    }
}

/* A step of time of two Jenkins elements and a normal spring, in plain steps from docs/theory.md, section 3.

   It shares no line with elastic_coulomb.c, which marches over cycles: time integration is the check of harmonic balance. */
#include <math.h>
#include <string.h>

#include "return_map.h"

enum { STICK, SLIP, OPEN };

/* dp/du (3, 3) [N/m] of a step, eq. (6.2); it is zero where the pair sticks.
   slides, t and alpha = mu N / |T_pred| are those of x and y; mu_kn = mu k_n is 0 where the pair is open. */
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

/* The i-th pair: p (3,) [N], dp/du (9,) and state after a step to du (3,) [m] from the tangential p before (2,) [N]. */
static void return_step(const spring_pairs *pairs, index_t i, const double du[3], const double before[2], double p[3],
                        double L[9], unsigned char *state)
{
    const double *k = pairs->k_t + 2 * i, *mu = pairs->mu + 2 * i, *w0 = pairs->w0 + 2 * i;
    const double N0 = pairs->N0[i], k_n = pairs->k_n[i], closing = N0 - k_n * du[2];
    const int is_open = closing <= 0.0, separate = pairs->separate[i];
    const double N = is_open ? 0.0 : closing;
    double stuck[2], T[2], t[2], alpha[2], mu_kn[2];
    int slides[2];
    for (int d = 0; d < 2; d++) {
        stuck[d] = k[d] * (du[d] - w0[d]);
        T[d] = stuck[d] + before[d];
    }
    const double length = sqrt(T[0] * T[0] + T[1] * T[1]);
    for (int d = 0; d < 2; d++) {
        const double size = separate ? fabs(T[d]) : length, limit = mu[d] * N, safe = size > 0.0 ? size : 1.0;
        slides[d] = size > limit || (is_open && k[0] > 0.0);
        t[d] = T[d] / safe;
        alpha[d] = limit / safe;
        mu_kn[d] = is_open ? 0.0 : mu[d] * k_n;
        p[d] = slides[d] ? limit * t[d] - stuck[d] : before[d];
    }
    p[2] = is_open ? (N0 > 0.0 ? N0 : 0.0) - k_n * du[2] : (N0 < 0.0 ? -N0 : 0.0);
    memset(L, 0, 9 * sizeof *L);
    step_derivative(k, slides, separate, t, alpha, mu_kn, L);
    if (is_open)
        L[8] = -k_n;
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

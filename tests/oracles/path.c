/* The law of pairs along the straight lines between samples: docs in path.py.  Plain arrays, row by row. */

#include <math.h>

#define TURN 6.283185307179586

/* T (2,) at the end of contact and the share of the way q at which slip sets in, each direction by itself. */
static void in_line(double *T, const double *q, double L_i, double L_j, double *onset)
{
    for (int d = 0; d < 2; d++) {
        double trial = T[d] + q[d], sign = (trial > 0.0) - (trial < 0.0);
        double room = L_i - sign * T[d], over = fabs(trial) - L_j;
        int slips = fabs(trial) > L_j;
        onset[d] = !slips ? 1.0 : room > 1e-12 * L_i ? room / (room + over) : 0.0;
        T[d] = slips ? sign * L_j : trial;
    }
}

/* The same for a friction circle. */
static void on_circle(double *T, const double *q, double L_i, double L_j, double *onset)
{
    double x = T[0] + q[0], y = T[1] + q[1], dL = L_j - L_i;
    onset[0] = onset[1] = 1.0;
    if (!(sqrt(x * x + y * y) > L_j)) {
        T[0] = x, T[1] = y;
        return;
    }
    double c = T[0] * T[0] + T[1] * T[1] - L_i * L_i, b = T[0] * q[0] + T[1] * q[1] - L_i * dL;
    double a = q[0] * q[0] + q[1] * q[1] - dL * dL, at_limit = 1e-12 * L_i * L_i, S = sqrt(fmax(b * b - a * c, 0.0));
    double share = b > 0.0 ? -c / (b + S) : (S - b) / a;
    share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
    if (c >= -at_limit && (c > at_limit || b > 0.0 || a <= 0.0))
        share = 0.0;
    onset[0] = onset[1] = share;
    T[0] += share * q[0], T[1] += share * q[1];
    double rest[2] = {(1.0 - share) * q[0], (1.0 - share) * q[1]}, length = sqrt(rest[0] * rest[0] + rest[1] * rest[1]);
    double towards = atan2(rest[1], rest[0]), at = T[0] != 0.0 || T[1] != 0.0 ? atan2(T[1], T[0]) : towards;
    if (length > 0.0) {
        double way = length / (0.5 * (L_i + share * dL + L_j)), shrink = isfinite(way) ? 1.0 / (1.0 + way + 0.5 * way * way) : 0.0;
        double angle = fmod(at - towards + 0.5 * TURN, TURN), half = 0.5 * (angle + (angle < 0.0 ? TURN : 0.0) - 0.5 * TURN);
        at = towards + 2.0 * atan2(shrink * sin(half), cos(half));
    }
    T[0] = L_j * cos(at), T[1] = L_j * sin(at);
}

/* A step of n pairs: T (n, 2) and, in its place, T after it; area (n, 2) and taken (n,) as line_step returns them. */
void line_step(int n, double *T, const double *q, const double *N_i, const double *N_j, const double *mu,
               const unsigned char *separate, double *area, double *taken)
{
    for (int i = 0; i < n; i++, T += 2, q += 2, area += 2) {
        double L_i = mu[i] * fmax(N_i[i], 0.0), L_j = mu[i] * fmax(N_j[i], 0.0), begin = 0.0, end = 1.0;
        if (L_i <= 0.0 && L_j > 0.0)
            begin = N_i[i] / (N_i[i] - N_j[i]);
        if (L_j <= 0.0 && L_i > 0.0)
            end = N_i[i] / (N_i[i] - N_j[i]);
        double T_a[2], T_b[2], chord[2], sigma[2];
        for (int d = 0; d < 2; d++)
            T_a[d] = T_b[d] = L_i > 0.0 ? T[d] : 0.0, chord[d] = (end - begin) * q[d];
        (separate[i] ? in_line : on_circle)(T_b, chord, L_i, L_j, sigma);
        taken[i] = 0.0;
        for (int d = 0; d < 2; d++) {
            /* p from its value before the step: at the begin of contact, where slip sets in, at the end of contact, after the step */
            double T_j = L_j > 0.0 ? T_b[d] : 0.0, onset = begin + sigma[d] * (end - begin);
            double p_a = T_a[d] - T[d] - begin * q[d], p_b = T_b[d] - T[d] - end * q[d], p_j = T_j - T[d] - q[d];
            area[d] = 0.5 * (begin * p_a + (end - onset) * (p_a + p_b) + (1.0 - end) * (p_b + p_j)) + (onset - begin) * p_a - 0.5 * p_j;
            if (L_i <= 0.0 && L_j <= 0.0)
                area[d] = 0.0;
            if (!(fabs(p_j) <= taken[i]))
                taken[i] = fabs(p_j);
            T[d] = T_j;
        }
    }
}

/* A period from T (n, 2): samples and areas (n_samples, n, 2) of ways q (n_samples, n, 2) to them, and the most slip (n,). */
void period(int n_samples, int n, const double *start, const double *q, const double *N, const double *mu,
            const unsigned char *separate, double *T, double *area, double *taken, double *slip)
{
    const double *before = start;
    for (int sample = 1; sample <= n_samples; sample++) {
        int i = (sample - 1) * n, j = sample % n_samples * n;
        for (int k = 0; k < 2 * n; k++)
            T[2 * j + k] = before[k];
        line_step(n, T + 2 * j, q + 2 * j, N + i, N + j, mu, separate, area + 2 * j, taken);
        for (int k = 0; k < n; k++)
            if (!(taken[k] <= slip[k]))
                slip[k] = taken[k];
        before = T + 2 * j;
    }
}

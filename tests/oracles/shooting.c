/* A period of time steps of a small system with contact: docs in shooting.py.  Plain arrays, row by row. */

#include <math.h>
#include <string.h>

#define MOST_DOF 64
#define MOST_PAIRS 32
#define SETTLED 1e-13
#define MOST_SWEEPS 300
#define PLAIN_SWEEPS 30 /* then halfway only: the law may answer too strongly */

typedef struct {
    int m;
    const double *mu, *N0, *k_t, *k_n; /* (m,) */
    const unsigned char *separate;     /* (m,) */
} Law;

/* T after contact with limits L to L_end while the pair goes along e, and the share of the way at which slip sets in. */
static double slide(double *T, const double *e, double L, double L_end)
{
    double x = T[0] + e[0], y = T[1] + e[1], growth = L_end - L;
    if (hypot(x, y) <= L_end) {
        T[0] = x, T[1] = y;
        return 1.0;
    }
    double a = e[0] * e[0] + e[1] * e[1] - growth * growth, b = T[0] * e[0] + T[1] * e[1] - L * growth;
    double c = fmin(0.0, T[0] * T[0] + T[1] * T[1] - L * L), root = sqrt(fmax(0.0, b * b - a * c));
    double onset = b > 0.0 ? -c / (b + root) : a != 0.0 ? (root - b) / a : 0.0;
    onset = fmin(1.0, fmax(0.0, onset));
    T[0] += onset * e[0], T[1] += onset * e[1];
    double limit = L + onset * growth, size = hypot(e[0], e[1]), length = (1.0 - onset) * size;
    if (size == 0.0) {
        double now = hypot(T[0], T[1]), to = now > 0.0 ? L_end / now : 0.0;
        T[0] *= to, T[1] *= to;
        return onset;
    }
    double ex = e[0] / size, ey = e[1] / size;
    if (limit <= 1e-14 * L_end || L_end <= 0.0) {
        T[0] = L_end * ex, T[1] = L_end * ey;
        return onset;
    }
    /* the angle psi from e to T: tan(psi / 2) falls by the exponential of the way over the limit */
    double mean = fabs(L_end - limit) > 1e-6 * L_end ? (L_end - limit) / log(L_end / limit) : 0.5 * (L_end + limit);
    double half = 0.5 * atan2(T[1] * ex - T[0] * ey, T[0] * ex + T[1] * ey);
    double psi = 2.0 * atan(tan(half) * exp(-length / mean));
    T[0] = L_end * (ex * cos(psi) - ey * sin(psi)), T[1] = L_end * (ey * cos(psi) + ex * sin(psi));
    return onset;
}

/* One direction, or two on a circle: the change of p = T - k_t du over a step, and its mean less that of a straight line. */
static void friction(int n, const double *T, const double *e, double N_i, double N_j, double mu, double *change, double *area)
{
    double begin = N_i <= 0.0 && N_j > 0.0 ? N_i / (N_i - N_j) : 0.0, end = N_j <= 0.0 && N_i > 0.0 ? N_i / (N_i - N_j) : 1.0;
    if (N_i <= 0.0 && N_j <= 0.0) {
        for (int d = 0; d < n; d++)
            change[d] = -T[d] - e[d], area[d] = 0.0;
        return;
    }
    double T_b[2] = {0.0, 0.0}, way[2] = {0.0, 0.0}, T_a[2] = {0.0, 0.0};
    for (int d = 0; d < n; d++)
        T_b[d] = T_a[d] = N_i > 0.0 ? T[d] : 0.0, way[d] = (end - begin) * e[d];
    double share = slide(T_b, way, mu * fmax(N_i, 0.0), mu * fmax(N_j, 0.0));
    if (share == 1.0 && begin == 0.0 && end == 1.0 && hypot(T_a[0] + way[0], T_a[1] + way[1]) <= mu * N_j) {
        for (int d = 0; d < n; d++)
            change[d] = area[d] = 0.0;
        return;
    }
    double onset = begin + share * (end - begin);
    for (int d = 0; d < n; d++) {
        double p_a = T_a[d] - T[d] - begin * e[d], p_b = T_b[d] - T[d] - end * e[d], p_j = (N_j > 0.0 ? T_b[d] : 0.0) - T[d] - e[d];
        change[d] = p_j;
        area[d] = 0.5 * (begin * p_a + (end - onset) * (p_a + p_b) + (1.0 - end) * (p_b + p_j)) + (onset - begin) * p_a - 0.5 * p_j;
    }
}

/* p (3 m) after a step from du to du_new, and its area. */
static void step(const Law *law, const double *du, const double *p, const double *du_new, double *p_new, double *area)
{
    for (int i = 0; i < law->m; i++) {
        const double *d = du + 3 * i, *d_new = du_new + 3 * i;
        double k_t = law->k_t[i], N_i = law->N0[i] - law->k_n[i] * d[2], N_j = law->N0[i] - law->k_n[i] * d_new[2];
        double T[2], e[2], change[2];
        for (int j = 0; j < 2; j++)
            T[j] = k_t * d[j] + p[3 * i + j], e[j] = k_t * (d_new[j] - d[j]);
        if (law->separate[i])
            for (int j = 0; j < 2; j++)
                friction(1, T + j, e + j, N_i, N_j, law->mu[i], change + j, area + 3 * i + j);
        else
            friction(2, T, e, N_i, N_j, law->mu[i], change, area + 3 * i);
        for (int j = 0; j < 2; j++)
            p_new[3 * i + j] = p[3 * i + j] + change[j];
        p_new[3 * i + 2] = fmax(-law->N0[i], 0.0) + fmin(N_j, 0.0);
        area[3 * i + 2] = (N_i > 0.0) != (N_j > 0.0) ? 0.5 * fabs(N_i * N_j / (N_j - N_i)) : 0.0;
    }
}

/* p at du of sliders that p_t states, back within their limits. */
static void at_rest(const Law *law, const double *du, const double *p_t, double *p)
{
    double area[3 * MOST_PAIRS];
    for (int i = 0; i < law->m; i++)
        p[3 * i] = p_t[2 * i], p[3 * i + 1] = p_t[2 * i + 1], p[3 * i + 2] = 0.0;
    step(law, du, p, du, p, area);
}

static void add(int rows, int columns, const double *A, const double *x, double *y)
{
    for (int i = 0; i < rows; i++) {
        double sum = 0.0;
        for (int j = 0; j < columns; j++)
            sum += A[i * columns + j] * x[j];
        y[i] += sum;
    }
}

static void at(int rows, int n_sums, const double *U, const double *basis, double *u)
{
    memset(u, 0, rows * sizeof *u);
    add(rows, n_sums, U, basis, u);
}

/* A period of N steps for each of c states x (c, 2 n + 2 m), in place.  Phi (2n, 2n), first, last and whole (2n, 3m), R (3m, n);
   U (3m, 5) and out_lin (5,): the stuck motion of pairs and output; basis (N, 5); out (n,).  moved (c, 2 m): sliders that moved;
   output (c, N); motion (c, N, 3 m): du.  Returns the number of steps whose fixed point was not found. */
int period(int n, int m, int N, int c, const double *Phi, const double *first, const double *last, const double *whole, const double *R,
           const double *U, const double *out_lin, const double *out, const double *basis, const double *mu, const double *N0,
           const double *k_t, const double *k_n, const unsigned char *separate, double *x, unsigned char *moved, double *output,
           double *motion)
{
    Law law = {m, mu, N0, k_t, k_n, separate};
    int rows = 3 * m, n_x = 2 * n + 2 * m, failed = 0;
    for (int k = 0; k < c; k++, x += n_x, moved += 2 * m, output += N, motion += rows * N) {
        double z[2 * MOST_DOF], free[2 * MOST_DOF], shift[2 * MOST_DOF], du[3 * MOST_PAIRS], du_free[3 * MOST_PAIRS];
        double du_new[3 * MOST_PAIRS], p[3 * MOST_PAIRS], p_new[3 * MOST_PAIRS], area[3 * MOST_PAIRS] = {0.0};
        memcpy(z, x, 2 * n * sizeof *z);
        memset(moved, 0, 2 * m);
        at(rows, 5, U, basis, du);
        add(rows, n, R, z, du);
        at_rest(&law, du, x + 2 * n, p);
        for (int j = 0; j < N; j++) {
            output[j] = 0.0;
            memcpy(motion + rows * j, du, rows * sizeof *du);
            add(1, n, out, z, output + j);
            add(1, 5, out_lin, basis + 5 * j, output + j);
            memset(free, 0, sizeof free);
            add(2 * n, 2 * n, Phi, z, free);
            add(2 * n, rows, first, p, free);
            at(rows, 5, U, basis + 5 * ((j + 1) % N), du_free);
            add(rows, n, R, free, du_free);
            memcpy(p_new, p, rows * sizeof *p);
            memset(area, 0, sizeof area);
            double change = 1.0;
            int sweep;
            for (sweep = 0; sweep < MOST_SWEEPS && change > SETTLED; sweep++) {
                double before[3 * MOST_PAIRS];
                memset(shift, 0, sizeof shift);
                add(n, rows, last, p_new, shift);
                add(n, rows, whole, area, shift);
                memcpy(du_new, du_free, rows * sizeof *du);
                add(rows, n, R, shift, du_new);
                memcpy(before, p_new, rows * sizeof *p);
                step(&law, du, p, du_new, p_new, area);
                change = 0.0;
                for (int i = 0; i < rows; i++) {
                    change = fmax(change, fabs(p_new[i] - before[i]) / (fabs(p_new[i]) + fabs(N0[i / 3])));
                    if (sweep >= PLAIN_SWEEPS)
                        p_new[i] = 0.5 * (p_new[i] + before[i]);
                }
            }
            failed += change > 1e4 * SETTLED;
            memcpy(z, free, 2 * n * sizeof *z);
            add(2 * n, rows, last, p_new, z);
            add(2 * n, rows, whole, area, z);
            for (int i = 0; i < m; i++)
                for (int d = 0; d < 2; d++)
                    moved[2 * i + d] |= fabs(p_new[3 * i + d] - p[3 * i + d]) > SETTLED * fabs(N0[i]);
            memcpy(p, p_new, rows * sizeof *p);
            memcpy(du, du_new, rows * sizeof *du);
        }
        memcpy(x, z, 2 * n * sizeof *z);
        for (int i = 0; i < m; i++)
            x[2 * n + 2 * i] = p[3 * i], x[2 * n + 2 * i + 1] = p[3 * i + 1];
    }
    return failed;
}

/* Sliders p_t (2 m), in place, of a given motion du (N, 3 m) after periods of it until one repeats, at most so many; their change. */
double sliders(int m, int N, int most, const double *mu, const double *N0, const double *k_t, const double *k_n,
               const unsigned char *separate, const double *du, double *p_t)
{
    Law law = {m, mu, N0, k_t, k_n, separate};
    double p[3 * MOST_PAIRS], p_new[3 * MOST_PAIRS], area[3 * MOST_PAIRS], change = 1.0;
    at_rest(&law, du, p_t, p);
    for (int k = 0; k < most && change > 1e-14; k++) {
        for (int i = 0; i < m; i++)
            p_t[2 * i] = p[3 * i], p_t[2 * i + 1] = p[3 * i + 1];
        for (int j = 0; j < N; j++) {
            step(&law, du + 3 * m * j, p, du + 3 * m * ((j + 1) % N), p_new, area);
            memcpy(p, p_new, 3 * m * sizeof *p);
        }
        change = 0.0;
        for (int i = 0; i < 2 * m; i++)
            change = fmax(change, fabs(p[3 * (i / 2) + i % 2] - p_t[i]) / fabs(N0[i / 2]));
    }
    return change;
}

/* The products of row_products.c for numbers of the type REAL. */

void NAME(combine)(index_t m, const REAL *const *rows, index_t n, const REAL *p, index_t N, REAL *y)
{
    const index_t chunk = CHUNK / sizeof(REAL);
    for (index_t i = 0; i < N * n; i++)
        y[i] = 0;
    for (index_t start = 0; start < n; start += chunk) {
        const index_t width = n - start < chunk ? n - start : chunk;
        index_t j = 0;
        for (; j + ROWS <= m; j += ROWS) {
            const REAL *a[ROWS];
            for (int k = 0; k < ROWS; k++)
                a[k] = rows[j + k] + start;
            for (index_t h = 0; h < N; h++) {
                const REAL *q = p + j * N + h;
                const REAL q0 = q[0], q1 = q[N], q2 = q[2 * N], q3 = q[3 * N];
                const REAL q4 = q[4 * N], q5 = q[5 * N], q6 = q[6 * N], q7 = q[7 * N];
                REAL *restrict to = y + h * n + start;
                for (index_t i = 0; i < width; i++)
                    to[i] += ((q0 * a[0][i] + q1 * a[1][i]) + (q2 * a[2][i] + q3 * a[3][i])) +
                             ((q4 * a[4][i] + q5 * a[5][i]) + (q6 * a[6][i] + q7 * a[7][i]));
            }
        }
        for (; j < m; j++)
            for (index_t h = 0; h < N; h++) {
                const REAL q = p[j * N + h], *a = rows[j] + start;
                REAL *restrict to = y + h * n + start;
                for (index_t i = 0; i < width; i++)
                    to[i] += q * a[i];
            }
    }
}

/* Add to sums (ROWS,) the products of ROWS rows with one vector. */
static void NAME(dots)(const REAL *const *a, const REAL *b, index_t n, REAL *sums)
{
    enum { WHOLE = sizeof(LANES) / sizeof(REAL) };
    LANES of_lanes[ROWS] = {{0}};
    index_t i = 0;
    for (; i + WHOLE <= n; i += WHOLE) {
        const LANES x = *(const LANES *)(b + i);
        for (int k = 0; k < ROWS; k++)
            of_lanes[k] += *(const LANES *)(a[k] + i) * x;
    }
    for (int k = 0; k < ROWS; k++) {
        REAL sum = 0;
        for (int l = 0; l < WHOLE; l++)
            sum += of_lanes[k][l];
        for (index_t rest = i; rest < n; rest++)
            sum += a[k][rest] * b[rest];
        sums[k] += sum;
    }
}

void NAME(project)(index_t m, const REAL *const *rows, index_t n, const REAL *x, index_t N, REAL *y)
{
    const index_t chunk = CHUNK / sizeof(REAL);
    for (index_t j = 0; j < m; j += ROWS) {
        const index_t count = m - j < ROWS ? m - j : ROWS;
        for (index_t i = 0; i < count * N; i++)
            y[j * N + i] = 0;
        for (index_t start = 0; start < n; start += chunk) {
            const REAL *a[ROWS];
            for (int k = 0; k < ROWS; k++)
                a[k] = rows[k < count ? j + k : j] + start;     /* beyond the last row: the first, not used */
            for (index_t h = 0; h < N; h++) {
                REAL sums[ROWS] = {0};
                NAME(dots)(a, x + h * n + start, n - start < chunk ? n - start : chunk, sums);
                for (index_t k = 0; k < count; k++)
                    y[(j + k) * N + h] += sums[k];
            }
        }
    }
}

/* The response of the modes is summed separately and added once: with stiff springs it is a small correction. */
void NAME(answer)(REAL *y, index_t N, index_t n, modal_answer modes, const REAL *R, index_t n_rows)
{
    REAL of_cosine[PART], of_sine[PART];
    for (index_t start = 0; start < N; start += modes.N_H)
        for (index_t h = 0; h < modes.n_harmonics; h++) {
            const int is_mean = modes.has_mean && h == 0;
            REAL *cosine = y + (start + modes.cosines[h]) * n, *sine = is_mean ? cosine : cosine + n;
            for (index_t from = 0; from < n_rows; from += PART) {
                const index_t width = n_rows - from < PART ? n_rows - from : PART;
                for (index_t i = 0; i < width; i++)
                    of_cosine[i] = of_sine[i] = 0;
                for (index_t k = 0; k < modes.m; k++) {
                    const double *c = modes.c + 2 * (k * modes.n_harmonics + h);
                    const double q_c = cosine[modes.first + k], q_s = is_mean ? 0.0 : sine[modes.first + k];
                    const REAL eta_c = (REAL)(c[0] * q_c + c[1] * q_s), eta_s = (REAL)(c[0] * q_s - c[1] * q_c);
                    const REAL *R_k = R + k * n_rows + from;
                    for (index_t i = 0; i < width; i++) {
                        of_cosine[i] += eta_c * R_k[i];
                        of_sine[i] += eta_s * R_k[i];
                    }
                }
                for (index_t i = 0; i < width; i++)
                    cosine[from + i] += of_cosine[i];
                for (index_t i = 0; i < width && !is_mean; i++)
                    sine[from + i] += of_sine[i];
            }
        }
}

/* Products of a matrix, given by the addresses of its rows, with few vectors, in one pass over the matrix.
 *
 *     combine: y = p^T A, (N, n), for p (m, N)        project: y = A x^T, (m, N), for x (N, n)
 *
 *     answer: y += R^T c q, for modal forces q that are further columns of y; c is complex, one number per mode and harmonic
 *
 *     project_rounded: y = A x^T for contiguous rows of 16-bit integers, each with a factor
 *
 * Rows of A have length n, contiguous, anywhere in memory.  The cost of such products is reading A: blocks of ROWS rows and CHUNK
 * bytes stay in the fastest cache for all N vectors.  The matrix product of a library would first copy A.
 */
#include "row_products.h"

#ifndef KERNEL
#define KERNEL(name) name##_baseline
#endif
#ifndef LANE_BYTES
#define LANE_BYTES 16                               /* of a register of the processor */
#endif

enum { ROWS = 8 };                                  /* rows per block */
enum { CHUNK = 2048 };                              /* bytes of each row per block */
enum { PART = 256 };                                /* rows of R^T at a time */

#pragma GCC diagnostic ignored "-Wpsabi"            /* lanes are never passed */
typedef double lanes_of_double __attribute__((vector_size(LANE_BYTES), aligned(sizeof(double)), may_alias));
typedef float lanes_of_float __attribute__((vector_size(LANE_BYTES), aligned(sizeof(float)), may_alias));
typedef short lanes_of_short __attribute__((vector_size(LANE_BYTES / 2), aligned(sizeof(short)), may_alias));

#define REAL double
#define LANES lanes_of_double
#define NAME(name) KERNEL(name##_rows_double)
#include "row_products_of.h"
#undef REAL
#undef LANES
#undef NAME

#define REAL float
#define LANES lanes_of_float
#define NAME(name) KERNEL(name##_rows_float)
#include "row_products_of.h"

void KERNEL(project_rounded)(index_t m, const short *A, const float *factors, index_t n, const float *x, index_t N, float *y)
{
    enum { WHOLE = LANE_BYTES / sizeof(float) };
    for (index_t j = 0; j < m; j += ROWS) {
        const index_t count = m - j < ROWS ? m - j : ROWS;
        const short *a[ROWS];
        for (int k = 0; k < ROWS; k++)
            a[k] = A + (k < count ? j + k : j) * n;                 /* beyond the last row: the first, not used */
        for (index_t h = 0; h < N; h++) {
            const float *b = x + h * n;
            lanes_of_float of_lanes[ROWS] = {{0}};
            index_t i = 0;
            for (; i + WHOLE <= n; i += WHOLE) {
                const lanes_of_float of_x = *(const lanes_of_float *)(b + i);
                for (int k = 0; k < ROWS; k++)
                    of_lanes[k] += __builtin_convertvector(*(const lanes_of_short *)(a[k] + i), lanes_of_float) * of_x;
            }
            for (int k = 0; k < count; k++) {
                float sum = 0;
                for (int l = 0; l < WHOLE; l++)
                    sum += of_lanes[k][l];
                for (index_t rest = i; rest < n; rest++)
                    sum += a[k][rest] * b[rest];
                y[h * m + j + k] = factors[j + k] * sum;
            }
        }
    }
}

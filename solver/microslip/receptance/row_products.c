/* Products of a matrix, given by the addresses of its rows, with few vectors, in one pass over the matrix.
 *
 *     combine: y = p^T A, (N, n), for p (m, N)        project: y = A x^T, (m, N), for x (N, n)
 *
 *     answer: y += R^T c q, for modal forces q that are further columns of y; c is complex, one number per mode and harmonic
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

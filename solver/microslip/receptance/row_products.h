/* The entry points of row_products.c, which is compiled once for each kind of processor. */
#ifndef MICROSLIP_ROW_PRODUCTS_H
#define MICROSLIP_ROW_PRODUCTS_H

#include <stddef.h>

#include "../system/processors.h"

typedef ptrdiff_t index_t;

typedef struct {                                    /* m modes that respond in some harmonics of a set */
    index_t m, first;                               /* first: the column of y with the force of the first mode */
    const double *c;                                /* (m, n_harmonics) complex: amplitudes are cos - i sin */
    index_t n_harmonics;
    const index_t *cosines;                         /* (n_harmonics,) their columns among the N_H coefficients of the set */
    int has_mean;                                   /* whether the first harmonic is the mean, which has no sine */
    index_t N_H;                                    /* coefficients of each of the N / N_H vectors in y */
} modal_answer;

#define DECLARE_OF(type, suffix)                                                                                             \
    void combine_rows_##type##suffix(index_t m, const type *const *rows, index_t n, const type *p, index_t N, type *y);      \
    void project_rows_##type##suffix(index_t m, const type *const *rows, index_t n, const type *x, index_t N, type *y); \
    void answer_rows_##type##suffix(type *y, index_t N, index_t n, modal_answer modes, const type *R, index_t n_rows);
#define DECLARE(suffix) DECLARE_OF(double, suffix) DECLARE_OF(float, suffix)
DECLARE_KERNELS

#endif

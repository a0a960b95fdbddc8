/* The entry points of elastic_coulomb.c, which is compiled once for each kind of processor. */
#ifndef MICROSLIP_ELASTIC_COULOMB_H
#define MICROSLIP_ELASTIC_COULOMB_H

#include <stddef.h>

#include "../system/processors.h"

typedef ptrdiff_t index_t;

typedef struct {
    index_t N_H, N_t;
    index_t stride;                                 /* N_H rounded up to a multiple of 4; padded with zeros */
    const double *E;                                /* (N_t, stride) rows of the synthesis matrix */
    const double *E_T;                              /* (N_H, N_t) its columns */
    int sampled;                                    /* the return map at the samples only */
    const double *F;                                /* (N_t, stride) columns of the analysis matrix */
    const double *S;                                /* (N_t + 1, stride) their running sums, S_0 = 0 */
} aft_tables;

typedef struct {
    const double *mu, *N0, *k_t, *k_n;              /* (n,) */
    const unsigned char *separate;                  /* (n,) */
    const double *w0;                               /* (n, 2) initial slider positions */
    const double *U;                                /* (n, 3, N_H) */
} aft_pairs;

#define DECLARE(suffix)                                                                                                      \
    int aft_leaves##suffix(const aft_tables *t, const aft_pairs *pairs, index_t n, unsigned char *leaves);                   \
    int aft_march##suffix(const aft_tables *t, const aft_pairs *pairs, index_t m, const index_t *active, double *p,          \
                          unsigned char *state, unsigned char *drifts, double *P);
DECLARE_KERNELS

#endif

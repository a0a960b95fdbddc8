/* The entry point of return_map.c. */
#ifndef MICROSLIP_RETURN_MAP_H
#define MICROSLIP_RETURN_MAP_H

#include <stddef.h>

typedef ptrdiff_t index_t;

typedef struct {                     /* the parameters of n pairs; x and y of a pair are consecutive */
    index_t n;
    const double *mu, *k_t, *w0;     /* (n, 2) */
    const double *N0, *k_n;          /* (n,) */
    const unsigned char *separate;   /* (n,) */
} spring_pairs;

void return_steps(const spring_pairs *pairs, index_t n_points, const double *du, const double *before, index_t stride, double *p,
                  double *L, unsigned char *state);
void vary_period(const spring_pairs *pairs, const index_t *motion, index_t n_steps, index_t n_sub, const double *du,
                 index_t most_periods, double *M, unsigned char *sticks, unsigned char *moves);

#endif

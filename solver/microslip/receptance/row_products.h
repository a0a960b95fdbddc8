/* The entry points of row_products.c, which is compiled once for each kind of processor, as the contact kernel is. */
#ifndef MICROSLIP_ROW_PRODUCTS_H
#define MICROSLIP_ROW_PRODUCTS_H

#include <stddef.h>

typedef ptrdiff_t index_t;

#define DECLARE_OF(type, suffix)                                                                                             \
    void combine_rows_##type##suffix(index_t m, const type *const *rows, index_t n, const type *p, index_t N, type *y);      \
    void project_rows_##type##suffix(index_t m, const type *const *rows, index_t n, const type *x, index_t N, type *y);
#define DECLARE(suffix) DECLARE_OF(double, suffix) DECLARE_OF(float, suffix)
DECLARE(_baseline)

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__INTEL_COMPILER) && __GNUC__ >= 12
#define FOR_EACH_PROCESSOR
DECLARE(_v3)
DECLARE(_v4)
#define OF_THIS_PROCESSOR(name)                                                                                              \
    (__builtin_cpu_supports("x86-64-v4") ? name##_v4 : __builtin_cpu_supports("x86-64-v3") ? name##_v3 : name##_baseline)
#else
#define OF_THIS_PROCESSOR(name) name##_baseline
#endif

#endif

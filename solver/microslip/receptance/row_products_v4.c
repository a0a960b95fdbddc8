/* The products for processors with AVX-512. */
#include "row_products.h"
#ifdef FOR_EACH_PROCESSOR
#pragma GCC target("arch=x86-64-v4")
#define LANE_BYTES 64
#define KERNEL(name) name##_v4
#include "row_products.c"
#endif

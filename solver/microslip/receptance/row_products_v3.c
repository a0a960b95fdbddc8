/* The products for processors with AVX2. */
#include "row_products.h"
#ifdef FOR_EACH_PROCESSOR
#pragma GCC target("arch=x86-64-v3")
#define LANE_BYTES 32
#define KERNEL(name) name##_v3
#include "row_products.c"
#endif

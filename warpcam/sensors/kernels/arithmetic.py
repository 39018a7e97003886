"""Arithmetic that is quick on a GPU; on a CPU it is that of Warp."""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
float result;
asm("lg2.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(base));
asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(exponent * result));
return result;
#else
return wp::pow(base, exponent);
#endif
""")
def power(base: wp.float32, exponent: wp.float32) -> wp.float32:
    """``base ** exponent`` of a base of at least 0 and an exponent above 0.

    On CUDA to a few millionths of it; numbers below 1e-38 count as 0.
    """
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
float reciprocal;
asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(reciprocal) : "f"(divisor));
const float nearly = number * reciprocal, rest = fmaf(-divisor, nearly, number);
return rest == rest ? fmaf(rest, reciprocal, nearly) : nearly;
#else
return number / divisor;
#endif
""")
def quotient(number: wp.float32, divisor: wp.float32) -> wp.float32:
    """``number / divisor`` of numbers that are not near the ends of the exponents.

    On CUDA one step of Newton's method behind an approximate reciprocal, which a loop over one divisor keeps;
    ``native/core/platform.h`` has the same function for native code.
    """
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
float result;
asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(number));
return result;
#else
return 1.0f / wp::sqrt(number);
#endif
""")
def inverse_root(number: wp.float32) -> wp.float32:
    """``1 / sqrt(number)`` of a number of at least 1e-38."""
    ...

// Differences between CUDA and CPU code: qualifiers, loads, a few arithmetic helpers.
#pragma once

// Products are added to without being rounded first, as on CUDA, but where a function says otherwise.
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(on)
#endif

namespace warpcam {

#if defined(__CUDA_ARCH__)
#define WARPCAM_DEVICE __device__ inline
// A function that may be large, of one caller in a kernel: called, it would copy the kernel's arguments to the stack.
#define WARPCAM_INLINED __device__ __forceinline__
#define WARPCAM_NOINLINE_CPU
#define WARPCAM_SHARED __shared__
#if !defined(WARPCAM_THREADS)
#define WARPCAM_THREADS 128
#endif
constexpr int THREADS = WARPCAM_THREADS;  // that work on one region of an image
#else
#define WARPCAM_DEVICE inline
#define WARPCAM_INLINED inline
// A function for a shape or a light, not for a pixel. On a CPU others with one caller are inlined there; with these,
// too, compiling would take half as long again.
#define WARPCAM_NOINLINE_CPU __attribute__((noinline))
#define WARPCAM_SHARED
constexpr int THREADS = 1;
#endif

constexpr int WARP_SIZE = 32;
constexpr unsigned FULL_WARP = 0xffffffffu;  // lanes of a warp
constexpr float MISS = 3.0e38f;  // stands for infinity where infinities would breed NaNs
// No ray goes farther. It is nearer than the boxes that stand for absent children of a node: a ray may run through all
// three of their planes at once.
constexpr float MAX_RAY_T = 1.0e25f;

// Four words that are loaded with one instruction.
struct alignas(16) Float3Int {
    float x, y, z;
    int w;
};

WARPCAM_DEVICE Float3Int load(const void* rows, unsigned index)
{
#if defined(__CUDA_ARCH__)
    const int4 bits = __ldg(static_cast<const int4*>(rows) + index);
    return { __int_as_float(bits.x), __int_as_float(bits.y), __int_as_float(bits.z), bits.w };
#else
    return static_cast<const Float3Int*>(rows)[index];
#endif
}

struct alignas(8) Float2 {
    float x, y;
};

struct Vec3 {
    float x, y, z;
};

// Neighbours that are loaded with one instruction.
template <class Value, int COUNT> struct alignas(COUNT * sizeof(Value)) AlignedArray {
    Value at[COUNT];
};

template <int COUNT, class Value> WARPCAM_DEVICE AlignedArray<Value, COUNT> load_vector(const Value* from)
{
    return *reinterpret_cast<const AlignedArray<Value, COUNT>*>(from);
}

// Four neighbours as they are loaded, in as many words as one has bytes: what is asked for long before it is used stays
// whole.
template <class Value> WARPCAM_DEVICE AlignedArray<unsigned, sizeof(Value)> load4(const Value* from)
{
    return load_vector<sizeof(Value)>(reinterpret_cast<const unsigned*>(from));
}

// An address in global memory in a register of its own, to which places are added: else the compiler adds what it is
// made of to each place.
template <class Value> WARPCAM_DEVICE Value* keep_address(Value* address)
{
#if defined(__CUDA_ARCH__)
    asm("" : "+l"(address));
    __builtin_assume(__isGlobal(address));
#endif
    return address;
}

#if defined(__CUDA_ARCH__)
WARPCAM_DEVICE float min(float a, float b) { return fminf(a, b); }
WARPCAM_DEVICE float max(float a, float b) { return fmaxf(a, b); }
WARPCAM_DEVICE float abs(float a) { return fabsf(a); }
#else
WARPCAM_DEVICE float min(float a, float b) { return a < b ? a : b; }
WARPCAM_DEVICE float max(float a, float b) { return a > b ? a : b; }
WARPCAM_DEVICE float abs(float a) { return __builtin_fabsf(a); }
#endif
WARPCAM_DEVICE constexpr int min(int a, int b) { return a < b ? a : b; }
WARPCAM_DEVICE int max(int a, int b) { return a > b ? a : b; }

// a * b and a * b + c, each rounded exactly as written, so that equal inputs give equal results everywhere.
WARPCAM_DEVICE float mul_rn(float a, float b)
{
#if defined(__CUDA_ARCH__)
    return __fmul_rn(a, b);
#else
#pragma clang fp contract(off)
    return a * b;
#endif
}

WARPCAM_DEVICE float fma(float a, float b, float c)
{
#if defined(__CUDA_ARCH__)
    return __fmaf_rn(a, b, c);
#else
#pragma clang fp contract(off)
    return a * b + c;
#endif
}

// Reciprocal and square root to about two units in the last place.
WARPCAM_DEVICE float rcp(float a)
{
#if defined(__CUDA_ARCH__)
    float r;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(a));
    return r;
#else
    return 1.0f / a;
#endif
}

// a / b, rounded as a division is if no number is near the ends of the exponents; reciprocal is that of b by rcp.
WARPCAM_DEVICE float quotient(float a, float b, float reciprocal)
{
#if defined(__CUDA_ARCH__)
    const float nearly = a * reciprocal, rest = fmaf(-b, nearly, a);
    return rest == rest ? fmaf(rest, reciprocal, nearly) : nearly;  // NaN beside an infinite quotient
#else
    return a / b;
#endif
}

WARPCAM_DEVICE float sqrt(float a)
{
#if defined(__CUDA_ARCH__)
    float r;
    asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(a));
    return r;
#else
    return __builtin_sqrtf(a);
#endif
}

// A divisor that is never zero.
WARPCAM_DEVICE float avoid_zero(float a) { return abs(a) < 1.0e-18f ? 1.0e-18f : a; }

WARPCAM_DEVICE float dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

WARPCAM_DEVICE int as_int(float a)
{
    union {
        float f;
        int i;
    } u;
    u.f = a;
    return u.i;
}

WARPCAM_DEVICE float as_float(int a)
{
    union {
        float f;
        int i;
    } u;
    u.i = a;
    return u.f;
}

WARPCAM_DEVICE int ctz(unsigned bits)
{
#if defined(__CUDA_ARCH__)
    return 31 - __clz(bits & -bits);  // not __ffs(), which reverses all bits first
#else
    return __builtin_ctz(bits);
#endif
}

}  // namespace warpcam

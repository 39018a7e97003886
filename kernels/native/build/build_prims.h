// Data of the mesh tree builder: boxes, shares of faces, nodes of the binary tree.
#pragma once

namespace warpcam {
namespace bvh4_build {

constexpr int kMaxLeaf = 12;               // faces in a leaf
constexpr int kMaxDepth = 16;              // levels of 4-wide nodes
constexpr int kMaxHeight = 2 * kMaxDepth;  // levels of binary nodes that are too large for a leaf
constexpr int kBins = 32;                  // a split is sought at the borders of so many bins along each axis ...
constexpr int kSweep = 16;                 // ... and between any two faces where there are at most this many
constexpr float kMinExtent = 1e-36f;       // centroids closer than this are the same

template <class T> inline T smaller(T a, T b) { return b < a ? b : a; }
template <class T> inline T larger(T a, T b) { return a < b ? b : a; }
template <class T> inline void swap(T& a, T& b)
{
    T c = a;
    a = b;
    b = c;
}

struct Box {
    float lower[3], upper[3];

    static Box empty() { return { { 3e38f, 3e38f, 3e38f }, { -3e38f, -3e38f, -3e38f } }; }

    void grow(const float* low, const float* high)
    {
        for (int k = 0; k < 3; ++k) {
            lower[k] = smaller(lower[k], low[k]);
            upper[k] = larger(upper[k], high[k]);
        }
    }

    void grow(const Box& box) { grow(box.lower, box.upper); }

    // The part that both have; false if there is none.
    bool clip(const Box& box)
    {
        bool any = true;
        for (int k = 0; k < 3; ++k) {
            lower[k] = larger(lower[k], box.lower[k]);
            upper[k] = smaller(upper[k], box.upper[k]);
            any = any && lower[k] <= upper[k];
        }
        return any;
    }

    float extent(int axis) const { return upper[axis] - lower[axis]; }

    // Half the surface: what the number of rays that hit the box is proportional to. Double, since it may be 1e37 or
    // 1e-40.
    double area() const
    {
        double x = extent(0), y = extent(1), z = extent(2);
        return x * y + y * z + z * x;
    }
};

// A face, or the share of it that lies in a box, on its way to its leaf.
struct BuildPrim {
    Box box;
    int face;
    unsigned char bin[3];  // along x, y, z

    float centroid(int axis) const { return 0.5f * (box.lower[axis] + box.upper[axis]); }
};

// The mesh as it was given.
struct Faces {
    const float* vertices;
    const int* indices;

    const float* corner(int face, int k) const { return vertices + 3ll * indices[3ll * face + k]; }
};

// A node of the binary tree. Children come after their parents. In one of at most kSweep items, these are [first, first
// + count).
struct BuildNode {
    Box box;
    int first, count;       // where its items start, and how many there are
    int child;              // the first of two in a row; 0 where count is 1
    float cost[3];          // of the cheapest 1, 2, 3 wide nodes or leaves that stand for it
    unsigned char left[5];  // left[n], n = 2..4: of n nodes the first child's share; 0: n - 1 do as well
    bool leaf;              // one node is best: a leaf
    short height;           // levels from here down of nodes with more than kMaxLeaf items
};

}  // namespace bvh4_build
}  // namespace warpcam

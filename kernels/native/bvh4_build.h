// Builds the 4-wide bounding volume hierarchy of one mesh, on the host, in three steps:
//   grow     a binary tree down to single faces, top down, by the surface area heuristic (SAH)
//   plan     for every binary node, the cheapest way to stand for it with at most 1, 2 or 3 nodes of the wide tree
//   flatten  the plan from the root down, written as the rows that the traversal reads (see Meshes in types.py)
// Needs no library: all memory is the caller's. Deterministic on one machine.
#pragma once

namespace warpcam {
namespace bvh4_build {

constexpr int kMaxLeaf = 8;                // faces in a leaf
constexpr int kMaxDepth = 16;              // levels of 4-wide nodes
constexpr int kMaxHeight = 2 * kMaxDepth;  // levels of binary nodes that are too large for a leaf
constexpr int kMaxFaces = kMaxLeaf << 24;  // in a mesh
constexpr int kBins = 32;                  // a split is sought at the borders of so many bins along each axis ...
constexpr int kSweep = 16;                 // ... and between any two faces where there are at most this many
constexpr float kFaceCost = 0.2f;          // a ray's work for a face, in units of its work for a node
constexpr float kAbsent = 1e30f;           // all the bounds of a child that is not there
constexpr float kMinExtent = 1e-36f;       // centroids closer than this are the same

template <class T>
inline T smaller(T a, T b) { return b < a ? b : a; }
template <class T>
inline T larger(T a, T b) { return a < b ? b : a; }
template <class T>
inline void swap(T& a, T& b) { T c = a; a = b; b = c; }

struct Box {
    float lower[3], upper[3];

    static Box empty() { return {{3e38f, 3e38f, 3e38f}, {-3e38f, -3e38f, -3e38f}}; }

    void grow(const float* low, const float* high)
    {
        for (int k = 0; k < 3; ++k) {
            lower[k] = smaller(lower[k], low[k]);
            upper[k] = larger(upper[k], high[k]);
        }
    }

    void grow(const Box& box) { grow(box.lower, box.upper); }

    float extent(int axis) const { return upper[axis] - lower[axis]; }

    // Half the surface: what the number of rays that hit the box is proportional to. Double, since it may be 1e37 or 1e-40.
    double area() const
    {
        double x = extent(0), y = extent(1), z = extent(2);
        return x * y + y * z + z * x;
    }
};

// A face on its way to its leaf.
struct Item {
    Box box;
    int face;
    unsigned char bin[3];  // along x, y, z

    float centroid(int axis) const { return 0.5f * (box.lower[axis] + box.upper[axis]); }
};

// A node of the binary tree. Its faces are items [first, first + count); children come after their parents.
struct Branch {
    Box box;
    int first, count;
    int child;              // the first of two in a row; 0 where count is 1
    float cost[3];          // of the cheapest 1, 2, 3 wide nodes or leaves that stand for it
    unsigned char left[5];  // left[n], n = 2..4: of n nodes the first child's share; 0: n - 1 do as well
    bool leaf;              // one node is best: a leaf
    short height;           // levels from here down of nodes with more than kMaxLeaf faces
};

// A way to part items: how many go first, and what that costs.
struct Split {
    double cost = 1e300;
    int first = 0;  // items in the first part; 0: no split found
    int bulk = 0;   // items in the larger part
    int axis = 0;
    int bin = 0;  // the last bin of the first part

    void offer(double new_cost, int new_first, int count, int new_axis, int new_bin)
    {
        int new_bulk = larger(new_first, count - new_first);
        if (new_cost < cost || (new_cost == cost && new_bulk < bulk)) *this = {new_cost, new_first, new_bulk, new_axis, new_bin};
    }
};

inline void sort_along(const Item* items, int count, int axis, unsigned char* order)
{
    for (int i = 0; i < count; ++i) {
        float key = items[i].centroid(axis);
        int j = i;
        for (; j > 0 && items[order[j - 1]].centroid(axis) > key; --j) order[j] = order[j - 1];
        order[j] = (unsigned char)i;
    }
}

// Parts a few items in the best of all ways that order one axis, with no part above `limit`. Returns the first part's count or 0.
inline int split_few(Item* items, int count, int limit)
{
    unsigned char orders[3][kSweep];
    Split best;
    for (int axis = 0; axis < 3; ++axis) {
        unsigned char* order = orders[axis];
        sort_along(items, count, axis, order);
        double after[kSweep];
        Box box = Box::empty();
        for (int i = count - 1; i > 0; --i) {
            box.grow(items[order[i]].box);
            after[i] = box.area() * (count - i);
        }
        box = Box::empty();
        for (int i = 1; i < count; ++i) {
            box.grow(items[order[i - 1]].box);
            if (larger(i, count - i) <= limit) best.offer(box.area() * i + after[i], i, count, axis, 0);
        }
    }
    if (best.first == 0) return 0;
    Item sorted[kSweep];
    for (int i = 0; i < count; ++i) sorted[i] = items[orders[best.axis][i]];
    for (int i = 0; i < count; ++i) items[i] = sorted[i];
    return best.first;
}

// The same for many items, by bins of their centroids, which lie in `centers`.
inline int split_many(Item* items, int count, int limit, const Box& centers)
{
    float scale[3];
    for (int axis = 0; axis < 3; ++axis) scale[axis] = centers.extent(axis) > kMinExtent ? kBins / centers.extent(axis) : 0.f;
    Box boxes[3][kBins];
    int counts[3][kBins];
    for (int axis = 0; axis < 3; ++axis)
        for (int b = 0; b < kBins; ++b) {
            boxes[axis][b] = Box::empty();
            counts[axis][b] = 0;
        }
    for (int i = 0; i < count; ++i)
        for (int axis = 0; axis < 3; ++axis) {
            int b = smaller((int)((items[i].centroid(axis) - centers.lower[axis]) * scale[axis]), kBins - 1);
            items[i].bin[axis] = (unsigned char)b;
            boxes[axis][b].grow(items[i].box);
            ++counts[axis][b];
        }
    Split best;
    for (int axis = 0; axis < 3; ++axis) {
        double after[kBins];
        int n = 0;
        Box box = Box::empty();
        for (int b = kBins - 1; b > 0; --b) {
            box.grow(boxes[axis][b]);
            n += counts[axis][b];
            after[b] = n ? box.area() * n : 0.;
        }
        n = 0;
        box = Box::empty();
        for (int b = 0; b < kBins - 1; ++b) {
            box.grow(boxes[axis][b]);
            n += counts[axis][b];
            if (n > 0 && n < count && larger(n, count - n) <= limit) best.offer(box.area() * n + after[b + 1], n, count, axis, b);
        }
    }
    if (best.first == 0) return 0;
    for (int i = 0, j = count - 1;; ++i, --j) {
        while (i <= j && items[i].bin[best.axis] <= best.bin) ++i;
        while (i <= j && items[j].bin[best.axis] > best.bin) --j;
        if (i >= j) break;
        swap(items[i], items[j]);
    }
    return best.first;
}

// The last resort: half and half, by the order of the centroids along the axis where they spread most. Never fails.
inline int split_halves(Item* items, int count, const Box& centers)
{
    int axis = 0;
    for (int k = 1; k < 3; ++k)
        if (centers.extent(k) > centers.extent(axis)) axis = k;
    int half = count / 2, low = 0, high = centers.extent(axis) > 0.f ? count - 1 : 0;
    while (low < high) {  // quickselect; the pivot is the median of three
        float a = items[low].centroid(axis), b = items[(low + high) / 2].centroid(axis), c = items[high].centroid(axis);
        float pivot = larger(smaller(a, b), smaller(larger(a, b), c));
        int i = low, j = high;
        while (i <= j) {
            while (items[i].centroid(axis) < pivot) ++i;
            while (items[j].centroid(axis) > pivot) --j;
            if (i <= j) swap(items[i++], items[j--]);
        }
        if (half <= j) high = j;
        else if (half >= i) low = i;
        else break;
    }
    return half;
}

inline void read_items(const float* vertices, const int* faces, int num_faces, Item* items)
{
    for (int f = 0; f < num_faces; ++f) {
        items[f] = {Box::empty(), f, {0, 0, 0}};
        for (int k = 0; k < 3; ++k) {
            const float* corner = vertices + 3ll * faces[3ll * f + k];
            items[f].box.grow(corner, corner);
        }
    }
}

// Builds the binary tree over the items, which it reorders. Returns its number of nodes, 2 * num_items - 1.
//
// A node at depth d parts so that no part is larger than what halving alone could still bring down to a leaf by kMaxHeight. While the
// heuristic keeps to that it chooses; meshes that lead it to peel off face after face get halved instead.
inline int grow(Item* items, int num_items, Branch* branches)
{
    struct Todo { int branch, depth; } stack[kMaxHeight + kMaxLeaf + 2];
    int top = 0, used = 1;
    branches[0].first = 0;
    branches[0].count = num_items;
    stack[top++] = {0, 0};
    while (top > 0) {
        Todo todo = stack[--top];
        Branch& branch = branches[todo.branch];
        Item* own = items + branch.first;
        int count = branch.count;
        branch.box = Box::empty();
        Box centers = Box::empty();
        for (int i = 0; i < count; ++i) {
            branch.box.grow(own[i].box);
            float center[3] = {own[i].centroid(0), own[i].centroid(1), own[i].centroid(2)};
            centers.grow(center, center);
        }
        branch.child = 0;
        if (count == 1) continue;
        int limit = count <= kMaxLeaf ? count : kMaxLeaf << smaller(kMaxHeight - todo.depth - 1, 24);
        int first = count <= kSweep ? split_few(own, count, limit) : split_many(own, count, limit, centers);
        if (first == 0) first = split_halves(own, count, centers);
        branch.child = used;
        branches[used].first = branch.first;
        branches[used].count = first;
        branches[used + 1].first = branch.first + first;
        branches[used + 1].count = count - first;
        stack[top++] = {used + 1, todo.depth + 1};
        stack[top++] = {used, todo.depth + 1};
        used += 2;
    }
    return used;
}

// Finds for each binary node, from the bottom up, the cheapest forest of 1, 2 and 3 wide nodes or leaves over its faces. The cost of a
// node or a face is its chance to be met by a ray that meets the root (the ratio of areas) times the work it then makes.
inline void plan(Branch* branches, int num_branches)
{
    double whole = branches[0].box.area();
    double scale = whole > 0. ? 1. / whole : 0.;
    for (int i = num_branches - 1; i >= 0; --i) {
        Branch& branch = branches[i];
        float area = (float)(branch.box.area() * scale);
        float as_leaf = branch.count <= kMaxLeaf ? area * kFaceCost * (float)branch.count : 3e38f;
        branch.leaf = branch.count == 1;
        branch.height = 0;
        branch.left[2] = branch.left[3] = branch.left[4] = 0;
        branch.cost[0] = branch.cost[1] = branch.cost[2] = as_leaf;
        if (branch.count == 1) continue;
        const Branch &a = branches[branch.child], &b = branches[branch.child + 1];
        if (branch.count > kMaxLeaf) branch.height = (short)(1 + larger(a.height, b.height));
        float two = a.cost[0] + b.cost[0];
        bool near = a.cost[0] + b.cost[1] < a.cost[1] + b.cost[0];
        float three = near ? a.cost[0] + b.cost[1] : a.cost[1] + b.cost[0];
        float four = a.cost[1] + b.cost[1];
        branch.left[4] = 2;
        if (a.cost[0] + b.cost[2] < four) four = a.cost[0] + b.cost[2], branch.left[4] = 1;
        if (a.cost[2] + b.cost[0] < four) four = a.cost[2] + b.cost[0], branch.left[4] = 3;
        branch.leaf = as_leaf <= area + four;
        branch.cost[0] = branch.leaf ? as_leaf : area + four;
        branch.left[2] = two < branch.cost[0];
        branch.cost[1] = branch.left[2] ? two : branch.cost[0];
        branch.left[3] = three < branch.cost[1] ? (near ? 1 : 2) : 0;
        branch.cost[2] = branch.left[3] ? three : branch.cost[1];
    }
}

// The binary nodes that become the children of the wide node made of `root`. Returns how many.
inline int open_planned(const Branch* branches, int root, int* children)
{
    struct Share { int branch, nodes; } stack[4];
    int top = 0, count = 0;
    stack[top++] = {root, 4};
    while (top > 0) {
        Share share = stack[--top];
        const Branch& branch = branches[share.branch];
        int left = share.nodes > 1 ? branch.left[share.nodes] : 0;
        if (left > 0) {
            stack[top++] = {branch.child + 1, share.nodes - left};
            stack[top++] = {branch.child, left};
        } else if (share.nodes > 1) {
            stack[top++] = {share.branch, share.nodes - 1};
        } else {
            children[count++] = share.branch;
        }
    }
    return count;
}

// The same, two binary levels down: the wide tree is then half as deep as the binary one.
inline int open_two_levels(const Branch* branches, int root, int* children)
{
    int count = 0;
    for (int side = 0; side < 2; ++side) {
        int child = branches[root].child + side;
        if (branches[child].count > kMaxLeaf) {
            children[count++] = branches[child].child;
            children[count++] = branches[child].child + 1;
        } else {
            children[count++] = child;
        }
    }
    return count;
}

inline void put(float* rows, int row, int column, float value) { rows[4ll * row + column] = value; }
inline void put(float* rows, int row, int column, int value) { __builtin_memcpy(rows + 4ll * row + column, &value, sizeof(float)); }

struct Size {
    int nodes, depth;
};

// Writes the wide tree, parents before children. `levels` is how many levels a node and what is below it may take: a node that its plan
// would make deeper is opened two binary levels instead, which always fits, since its height is never more than 2 * levels.
inline Size flatten(const Branch* branches, float* rows)
{
    struct Todo { int branch, node, levels; } stack[3 * kMaxDepth + 1];
    int top = 0;
    Size size = {1, 1};
    stack[top++] = {0, 0, kMaxDepth};
    while (top > 0) {
        Todo todo = stack[--top];
        const Branch& branch = branches[todo.branch];
        int below = todo.levels - 1;
        auto is_leaf = [&](int child) { return branches[child].leaf || (below == 0 && branches[child].count <= kMaxLeaf); };
        int children[4], inner[4], count = 1, num_inner = 0;
        children[0] = todo.branch;
        if (!branch.leaf) {
            count = open_planned(branches, todo.branch, children);
            bool fits = true;
            for (int k = 0; k < count; ++k) fits = fits && (is_leaf(children[k]) || branches[children[k]].height <= 2 * below);
            if (!fits) count = open_two_levels(branches, todo.branch, children);
        }
        size.depth = larger(size.depth, kMaxDepth - below);
        for (int k = 0; k < 4; ++k) {
            const Branch* child = k < count ? branches + children[k] : nullptr;
            for (int axis = 0; axis < 3; ++axis) {
                put(rows, 7 * todo.node + axis, k, child ? child->box.lower[axis] : kAbsent);
                put(rows, 7 * todo.node + 3 + axis, k, child ? child->box.upper[axis] : kAbsent);
            }
            int code = 0;
            if (child && is_leaf(children[k])) {
                code = -(child->first * 16 + child->count) - 1;
            } else if (child) {
                code = size.nodes + num_inner;
                inner[num_inner++] = children[k];
            }
            put(rows, 7 * todo.node + 6, k, code);
        }
        for (int k = num_inner - 1; k >= 0; --k) stack[top++] = {inner[k], size.nodes + k, below};
        size.nodes += num_inner;
    }
    return size;
}

inline void write_faces(const float* vertices, const int* faces, const Item* items, int num_faces, float* rows)
{
    for (int i = 0; i < num_faces; ++i)
        for (int k = 0; k < 3; ++k) {
            const float* corner = vertices + 3ll * faces[3ll * items[i].face + k];
            for (int axis = 0; axis < 3; ++axis) put(rows, 3 * i + k, axis, corner[axis]);
            put(rows, 3 * i + k, 3, k == 0 ? items[i].face : 0);
        }
}

// Room for `num_faces` > 0 faces: node_rows (7 * num_faces, 4), face_rows (3 * num_faces, 4); `scratch` 160 bytes a face, aligned to 4.
// The face indices are in range and the vertices' magnitude is below 1e18.
inline Size build(const float* vertices, const int* faces, int num_faces, void* scratch, float* node_rows, float* face_rows)
{
    static_assert(sizeof(Item) + 2 * sizeof(Branch) <= 160, "scratch is too small");
    static_assert(kMaxFaces <= (0x7fffffff >> 4) + 1, "a leaf's code must fit in an int");
    Item* items = (Item*)scratch;
    Branch* branches = (Branch*)(items + num_faces);
    read_items(vertices, faces, num_faces, items);
    int num_branches = grow(items, num_faces, branches);
    plan(branches, num_branches);
    Size size = flatten(branches, node_rows);
    write_faces(vertices, faces, items, num_faces, face_rows);
    return size;
}

}  // namespace bvh4_build
}  // namespace warpcam

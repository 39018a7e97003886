// Builds the 4-wide bounding volume hierarchy of one mesh, on the host, in three steps:
//   grow     a binary tree down to single faces or shares of faces, top down, by the surface area heuristic (SAH)
//   plan     for every binary node, the cheapest way to stand for it with at most 1, 2 or 3 nodes of the wide tree
//   flatten  the plan from the root down, written as the rows that the traversal reads (see Meshes in types.py)
// Needs no library: all memory is the caller's. Deterministic on one machine.
#pragma once
#include "build/spatial_split.h"
#include "build/object_split.h"

namespace warpcam {
namespace bvh4_build {

constexpr int kMaxFaces = 67000000;      // in a mesh: with their cuts they must fit in the code of a leaf, an int
constexpr double kOverlap =
    0.01;  // a node is cut only where else its halves' boxes share this part of the root's surface
constexpr float kLeafCost = 54.f / 86;   // a ray's work for a leaf, in units of that for a node ...
constexpr float kRoundCost = 54.f / 86;  // ... for each four faces in it, which four lanes test at a time ...
constexpr float kFaceCost = 0.06f;  // ... and for each face, which lanes on their own and CPUs test one after another
constexpr float kAbsent = 1e30f;  // all the bounds of a child that is not there
constexpr int kScratch = 320;  // bytes a face

// Places for items: faces, and what cutting them adds.
constexpr int room_for(int num_faces) { return 2 * num_faces; }

inline void read_items(const Faces& mesh, int num_faces, BuildPrim* items)
{
    for (int f = 0; f < num_faces; ++f) {
        items[f] = { Box::empty(), f, { 0, 0, 0 } };
        for (int k = 0; k < 3; ++k)
            items[f].box.grow(mesh.corner(f, k), mesh.corner(f, k));
    }
}

// Gives a node's items to two children. Returns where in its `room` places the second's start; `sizes` become the
// children's.
inline int divide(const Faces& mesh, BuildPrim* items, int count, int room, int limit, const Box& box,
                  const Box& centers, double root_area, int* sizes)
{
    int first = 0;
    if (count <= kSweep) {
        first = split_few(items, count, limit);
    } else {
        ObjectSplit split = find_split(items, count, limit, centers);
        bool worse = split.first == 0 || split.overlap > kOverlap * root_area;
        if (worse && room > count) {
            SpatialSplit cut = find_cut(mesh, items, count, limit, room - count, box);
            Parts parts = {};
            if (cut.cost < split.cost)
                parts = part(mesh, items, count, room, limit, cut);
            if (parts.second > 0) {
                sizes[0] = parts.first;
                sizes[1] = parts.second;
                return parts.first_room;
            }
        }
        if (split.first > 0)
            part(items, count, split);
        first = split.first;
    }
    if (first == 0)
        first = split_halves(items, count, centers);
    sizes[0] = first;
    sizes[1] = count - first;
    if (room == count || count <= kSweep)
        return first;  // no room is needed where nothing more is cut
    double areas[2] = { 0., 0. };  // large boxes have the most to gain from a cut
    for (int i = 0; i < count; ++i)
        areas[i >= first] += items[i].box.area();
    double sum = areas[0] + areas[1];
    int second = first + (int)((room - count) * (sum > 0. ? areas[0] / sum : 0.5));
    for (int i = count - 1; i >= first; --i)
        items[second + i - first] = items[i];
    return second;
}

// Builds the binary tree over the items, which it reorders and adds to, up to `room`. Returns its number of nodes.
//
// A node at depth d parts so that no part is larger than what halving alone could still bring down to a leaf by
// kMaxHeight. While the heuristic keeps to that it chooses; meshes that lead it to peel off face after face get halved
// instead.
inline int grow(const Faces& mesh, BuildPrim* items, int num_items, int room, BuildNode* branches)
{
    struct Todo {
        int branch, depth, room;
    } stack[kMaxHeight + kMaxLeaf + 2];
    int top = 0, used = 1;
    double root_area = 0.;
    branches[0].first = 0;
    branches[0].count = num_items;
    stack[top++] = { 0, 0, room };
    while (top > 0) {
        Todo todo = stack[--top];
        BuildNode& branch = branches[todo.branch];
        BuildPrim* own = items + branch.first;
        int count = branch.count;
        branch.box = Box::empty();
        branch.child = 0;
        Box centers = Box::empty();
        for (int i = 0; i < count; ++i) {
            branch.box.grow(own[i].box);
            float center[3] = { own[i].centroid(0), own[i].centroid(1), own[i].centroid(2) };
            centers.grow(center, center);
        }
        if (todo.branch == 0)
            root_area = branch.box.area();
        if (count == 1)
            continue;
        int limit = count <= kMaxLeaf ? count : kMaxLeaf << smaller(kMaxHeight - todo.depth - 1, 24);
        int sizes[2];
        int second = divide(mesh, own, count, todo.room, limit, branch.box, centers, root_area, sizes);
        branch.child = used;
        for (int side = 0; side < 2; ++side) {
            branches[used + side].first = branch.first + (side ? second : 0);
            branches[used + side].count = sizes[side];
        }
        stack[top++] = { used + 1, todo.depth + 1, todo.room - second };
        stack[top++] = { used, todo.depth + 1, second };
        used += 2;
    }
    return used;
}

inline float leaf_cost(int faces)
{
    return kLeafCost + kRoundCost * (float)((faces + 3) / 4) + kFaceCost * (float)faces;
}

// Finds for each binary node, from the bottom up, the cheapest forest of 1, 2 and 3 wide nodes or leaves over its
// faces. The cost of a node or a face is its chance to be met by a ray that meets the root (the ratio of areas) times
// the work it then makes.
inline void plan(BuildNode* branches, int num_branches, float (*leaf_cost)(int) = bvh4_build::leaf_cost)
{
    double whole = branches[0].box.area();
    double scale = whole > 0. ? 1. / whole : 0.;
    for (int i = num_branches - 1; i >= 0; --i) {
        BuildNode& branch = branches[i];
        if (branch.child > 0) {  // cut faces fill less than their boxes did
            branch.box = branches[branch.child].box;
            branch.box.grow(branches[branch.child + 1].box);
        }
        float area = (float)(branch.box.area() * scale);
        float as_leaf = branch.count <= kMaxLeaf ? area * leaf_cost(branch.count) : 3e38f;
        branch.leaf = branch.count == 1;
        branch.height = 0;
        branch.left[2] = branch.left[3] = branch.left[4] = 0;
        branch.cost[0] = branch.cost[1] = branch.cost[2] = as_leaf;
        if (branch.count == 1)
            continue;
        const BuildNode &a = branches[branch.child], &b = branches[branch.child + 1];
        if (branch.count > kMaxLeaf)
            branch.height = (short)(1 + larger(a.height, b.height));
        float two = a.cost[0] + b.cost[0];
        bool near = a.cost[0] + b.cost[1] < a.cost[1] + b.cost[0];
        float three = near ? a.cost[0] + b.cost[1] : a.cost[1] + b.cost[0];
        float four = a.cost[1] + b.cost[1];
        branch.left[4] = 2;
        if (a.cost[0] + b.cost[2] < four)
            four = a.cost[0] + b.cost[2], branch.left[4] = 1;
        if (a.cost[2] + b.cost[0] < four)
            four = a.cost[2] + b.cost[0], branch.left[4] = 3;
        branch.leaf = as_leaf <= area + four;
        branch.cost[0] = branch.leaf ? as_leaf : area + four;
        branch.left[2] = two < branch.cost[0];
        branch.cost[1] = branch.left[2] ? two : branch.cost[0];
        branch.left[3] = three < branch.cost[1] ? (near ? 1 : 2) : 0;
        branch.cost[2] = branch.left[3] ? three : branch.cost[1];
    }
}

// The binary nodes that become the children of the wide node made of `root`. Returns how many.
inline int open_planned(const BuildNode* branches, int root, int* children)
{
    struct LightWeights {
        int branch, nodes;
    } stack[4];
    int top = 0, count = 0;
    stack[top++] = { root, 4 };
    while (top > 0) {
        LightWeights share = stack[--top];
        const BuildNode& branch = branches[share.branch];
        int left = share.nodes > 1 ? branch.left[share.nodes] : 0;
        if (left > 0) {
            stack[top++] = { branch.child + 1, share.nodes - left };
            stack[top++] = { branch.child, left };
        } else if (share.nodes > 1) {
            stack[top++] = { share.branch, share.nodes - 1 };
        } else {
            children[count++] = share.branch;
        }
    }
    return count;
}

// Opens a node two binary levels down: the wide tree is then half as deep as the binary one.
inline int open_two_levels(const BuildNode* branches, int root, int* children)
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
inline void put(float* rows, int row, int column, int value)
{
    __builtin_memcpy(rows + 4ll * row + column, &value, sizeof(float));
}

struct Size {
    int nodes, depth, faces;
};

// Writes the wide tree, parents before children, and the faces of its leaves to `order`. `levels` is how many levels a
// node and what is below it may take: a node that its plan would make deeper is opened two binary levels instead, which
// always fits, since its height is never more than 2 * levels.
inline Size flatten(const BuildNode* branches, const BuildPrim* items, float* rows, int* order)
{
    struct Todo {
        int branch, node, levels;
    } stack[3 * kMaxDepth + 1];
    int top = 0;
    Size size = { 1, 1, 0 };
    stack[top++] = { 0, 0, kMaxDepth };
    while (top > 0) {
        Todo todo = stack[--top];
        const BuildNode& branch = branches[todo.branch];
        int below = todo.levels - 1;
        auto is_leaf = [&](int child) {
            return branches[child].leaf || (below == 0 && branches[child].count <= kMaxLeaf);
        };
        int children[4], inner[4], count = 1, num_inner = 0;
        children[0] = todo.branch;
        if (!branch.leaf) {
            count = open_planned(branches, todo.branch, children);
            bool fits = true;
            for (int k = 0; k < count; ++k)
                fits = fits && (is_leaf(children[k]) || branches[children[k]].height <= 2 * below);
            if (!fits)
                count = open_two_levels(branches, todo.branch, children);
        }
        size.depth = larger(size.depth, kMaxDepth - below);
        for (int k = 0; k < 4; ++k) {
            const BuildNode* child = k < count ? branches + children[k] : nullptr;
            for (int axis = 0; axis < 3; ++axis) {
                put(rows, 7 * todo.node + axis, k, child ? child->box.lower[axis] : kAbsent);
                put(rows, 7 * todo.node + 3 + axis, k, child ? child->box.upper[axis] : kAbsent);
            }
            int code = 0;
            if (child && is_leaf(children[k])) {
                code = -(size.faces * 16 + child->count) - 1;
                for (int i = 0; i < child->count; ++i)
                    order[size.faces++] = items[child->first + i].face;
            } else if (child) {
                code = size.nodes + num_inner;
                inner[num_inner++] = children[k];
            }
            put(rows, 7 * todo.node + 6, k, code);
        }
        for (int k = num_inner - 1; k >= 0; --k)
            stack[top++] = { inner[k], size.nodes + k, below };
        size.nodes += num_inner;
    }
    return size;
}

inline void write_faces(const Faces& mesh, const int* order, int count, float* rows)
{
    for (int i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) {
            for (int axis = 0; axis < 3; ++axis)
                put(rows, 3 * i + k, axis, mesh.corner(order[i], k)[axis]);
            put(rows, 3 * i + k, 3, k == 0 ? order[i] : 0);
        }
}

// Room for room_for(num_faces) nodes and faces, num_faces > 0: node_rows (7 * node, 4), face_rows (3 * face, 4);
// `scratch` kScratch bytes a face, aligned to 4. The face indices are in range and the vertices' magnitude is below
// 1e18.
inline Size build(const float* vertices, const int* faces, int num_faces, void* scratch, float* node_rows,
                  float* face_rows)
{
    static_assert(2 * sizeof(BuildPrim) + 4 * sizeof(BuildNode) + 2 * sizeof(int) <= kScratch, "scratch is too small");
    static_assert(kMaxLeaf <= kSweep, "the items of a leaf must lie in a row, and be of different faces");
    static_assert(room_for(kMaxFaces) <= 0x7fffffff >> 4, "a leaf's code must fit in an int");
    Faces mesh = { vertices, faces };
    int room = room_for(num_faces);
    BuildPrim* items = (BuildPrim*)scratch;
    BuildNode* branches = (BuildNode*)(items + room);
    int* order = (int*)(branches + 2 * room);
    read_items(mesh, num_faces, items);
    int num_branches = grow(mesh, items, num_faces, room, branches);
    plan(branches, num_branches);
    Size size = flatten(branches, items, node_rows, order);
    write_faces(mesh, order, size.faces, face_rows);
    return size;
}

}  // namespace bvh4_build
}  // namespace warpcam

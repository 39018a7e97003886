// The 4-wide tree over boxes, for what is no triangle: the builder of meshes without its cuts.
#pragma once
#include "build/bvh4_builder.h"

namespace warpcam {
namespace bvh4_build {

// A ray's work for a leaf of boxes, in units of that for a node: one Gaussian after another (measured: fewest nodes and
// Gaussians together).
inline float boxes_cost(int boxes) { return 0.1f + 0.5f * (float)boxes; }

// `boxes` are lower and upper corner, 6 numbers each, num_boxes > 0. Room for num_boxes nodes in node_rows (7 * node,
// 4) and as many places in `order`, which becomes the boxes in leaf order; `scratch` kScratch bytes a box, aligned to
// 4.
inline Size build_boxes(const float* boxes, int num_boxes, void* scratch, float* node_rows, int* order)
{
    Faces none = { nullptr, nullptr };  // nobody asks for corners where there is no room for cuts
    BuildPrim* items = (BuildPrim*)scratch;
    BuildNode* branches = (BuildNode*)(items + num_boxes);
    for (int i = 0; i < num_boxes; ++i) {
        items[i] = { Box::empty(), i, { 0, 0, 0 } };
        items[i].box.grow(boxes + 6ll * i, boxes + 6ll * i + 3);
    }
    int num_branches = grow(none, items, num_boxes, num_boxes, branches);
    plan(branches, num_branches, boxes_cost);
    return flatten(branches, items, node_rows, order);
}

}  // namespace bvh4_build
}  // namespace warpcam

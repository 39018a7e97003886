// Warp's own headers and all of kernels/native, for the compiler of CPU kernels: what fast_compile.py has it include
// first is in the headers that are precompiled. Most of the time that a kernel takes would go into reading them again.
#pragma once

// As Warp's sources have it; none of our kernels asks for tiles of its own.
#define WP_NO_CRT
#define WP_TILE_BLOCK_DIM 1
#include "builtin.h"
#undef WP_TILE_BLOCK_DIM

#include "build/box_builder.h"  // before core/platform.h, which lets products be added to without being rounded
#include "shading/plane_vertex_lighting.h"
#include "shadow/many_casters.h"
#include "flow/shape_motion.h"
#include "build/horizon_builder.h"
#include "traversal/visibility_listed.h"
#include "shading_pass/mirror_visibility.h"
#include "output/pack.h"
#include "accel/refit.h"
#include "shading_pass/shading_pass.h"
#include "shadow/shadow_pass.h"
#include "build/occluder_builder.h"
#include "antialiasing/edge_resolve.h"
#include "traversal/view_shape_list.h"
#include "splats/gaussian_blend.h"
#include "traversal/visibility.h"
#include "path/path_tracer.h"
#include "occlusion/occluders.h"
#include "occlusion/occlusion_filter.h"
#include "occlusion/reflection_filter.h"

// Kernels that call none of these are compiled as Warp compiles others.
#pragma clang fp contract(off)

// Warp's own headers and all of kernels/native, for the compiler of CPU kernels: what fast_compile.py has it include
// first is in the headers that are precompiled. Most of the time that a kernel takes would go into reading them again.
#pragma once

// As Warp's sources have it; none of our kernels asks for tiles of its own.
#define WP_NO_CRT
#define WP_TILE_BLOCK_DIM 1
#include "builtin.h"
#undef WP_TILE_BLOCK_DIM

#include "bvh4_boxes.h"  // before lanes.h, which lets products be added to without being rounded
#include "corners.h"
#include "crowd.h"
#include "flow_motion.h"
#include "horizon_build.h"
#include "listed.h"
#include "mirror.h"
#include "pack.h"
#include "refit.h"
#include "resolve.h"
#include "shadow.h"
#include "shutter_build.h"
#include "smooth.h"
#include "sorted.h"
#include "splats.h"
#include "visibility.h"

// Kernels that call none of these are compiled as Warp compiles others.
#pragma clang fp contract(off)

// Products of 3 x 3 matrices and vectors, of single vectors and, on a CPU, of packets of eight.
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

struct Mat3 {
    float at[3][3];
};

// A matrix of Warp's.
template <class Matrix> WARPCAM_DEVICE Mat3 as_mat3(const Matrix& matrix)
{
    Mat3 m;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            m.at[i][j] = matrix.data[i][j];
    return m;
}

template <class Vector = Vec3> WARPCAM_DEVICE Vector transform(const Mat3& m, Vector v)
{
    return { m.at[0][0] * v.x + m.at[0][1] * v.y + m.at[0][2] * v.z,
             m.at[1][0] * v.x + m.at[1][1] * v.y + m.at[1][2] * v.z,
             m.at[2][0] * v.x + m.at[2][1] * v.y + m.at[2][2] * v.z };
}

WARPCAM_DEVICE Vec3 transform_transposed(const Mat3& m, Vec3 v)  // transpose(m) v
{
    return { m.at[0][0] * v.x + m.at[1][0] * v.y + m.at[2][0] * v.z,
             m.at[0][1] * v.x + m.at[1][1] * v.y + m.at[2][1] * v.z,
             m.at[0][2] * v.x + m.at[1][2] * v.y + m.at[2][2] * v.z };
}

WARPCAM_DEVICE Mat3 transposed_times(const Mat3& a, const Mat3& b)  // transpose(a) b
{
    Mat3 m;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            m.at[i][j] = a.at[0][i] * b.at[0][j] + a.at[1][i] * b.at[1][j] + a.at[2][i] * b.at[2][j];
    return m;
}

// Product of a vector with the matrix whose rows are a shape's axes: `axis_x`, `axis_y` and `axis_z` of a record.
template <class Rows, class Vector = Vec3> WARPCAM_DEVICE Vector transform_rows(const Rows& rows, Vector v)
{
    const Float3Int ax = rows.axis_x, ay = rows.axis_y, az = rows.axis_z;
    return { ax.x * v.x + ax.y * v.y + ax.z * v.z, ay.x * v.x + ay.y * v.y + ay.z * v.z,
             az.x * v.x + az.y * v.y + az.z * v.z };
}

// Likewise, and of `start` added to it.
template <class Rows, class Vector = Vec3>
WARPCAM_DEVICE Vector transform_rows(const Rows& rows, Vector v, const Float3Int& start)
{
    const Float3Int ax = rows.axis_x, ay = rows.axis_y, az = rows.axis_z;
    return { ax.x * v.x + ax.y * v.y + ax.z * v.z + start.x, ay.x * v.x + ay.y * v.y + ay.z * v.z + start.y,
             az.x * v.x + az.y * v.y + az.z * v.z + start.z };
}

// Product of a vector with the transpose of such a matrix.
template <class Rows, class Vector = Vec3> WARPCAM_DEVICE Vector transform_rows_transposed(const Rows& rows, Vector v)
{
    const Float3Int ax = rows.axis_x, ay = rows.axis_y, az = rows.axis_z;
    return { ax.x * v.x + ay.x * v.y + az.x * v.z, ax.y * v.x + ay.y * v.y + az.y * v.z,
             ax.z * v.x + ay.z * v.y + az.z * v.z };
}

}  // namespace warpcam

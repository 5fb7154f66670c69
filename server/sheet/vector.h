#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

/// Points and directions. Mesh data arrive and stay as float32; what is computed once per event or per frame is double.
namespace rustle::sheet {

using Vec2f = Eigen::Vector2f;
using Vec3f = Eigen::Vector3f;
using Vec4f = Eigen::Vector4f;  ///< a point with a 0 behind it: one load, one store
using Vec2d = Eigen::Vector2d;
using Vec3d = Eigen::Vector3d;

}  // namespace rustle::sheet

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * libcamera's manager of cameras. libcamera ends a program that has two of them at one time, so
 * all sources share one: it begins with the first user and ends with the last. It follows what is
 * plugged in and out.
 */
#ifndef LP_SOURCE_LIBCAMERA_MANAGER_HPP
#define LP_SOURCE_LIBCAMERA_MANAGER_HPP

#include <libcamera/libcamera.h>

namespace lp
{

/* One user of the manager. From any thread; keeps no camera, so give cameras back before. */
class ManagerUse
{
      public:
	ManagerUse();
	~ManagerUse();
	ManagerUse(const ManagerUse &) = delete;
	ManagerUse &operator=(const ManagerUse &) = delete;

	/* 0, or -errno: libcamera could not start, and get() must not be called. */
	int error() const;
	libcamera::CameraManager &get() const;

      private:
	int ret;
};

} // namespace lp

#endif

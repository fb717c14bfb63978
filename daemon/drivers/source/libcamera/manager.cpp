/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/manager.hpp"

#include <memory>
#include <mutex>

namespace lp
{
namespace
{

/* There is one manager per process, so its users are counted for the process. */
std::mutex lock; /* of what follows; held while the manager begins and ends */
std::unique_ptr<libcamera::CameraManager> manager;
int users;

} // namespace

ManagerUse::ManagerUse()
{
	const std::lock_guard<std::mutex> guard(lock);

	ret = 0;
	if (!manager) {
		manager = std::make_unique<libcamera::CameraManager>();
		ret = manager->start();
	}
	if (ret < 0)
		manager.reset();
	else
		users++;
}

ManagerUse::~ManagerUse()
{
	const std::lock_guard<std::mutex> guard(lock);

	if (ret == 0 && --users == 0)
		manager.reset();
}

int ManagerUse::error() const
{
	return ret;
}

/* The lock is not needed: the manager stays as long as this user does. */
libcamera::CameraManager &ManagerUse::get() const
{
	return *manager;
}

} // namespace lp

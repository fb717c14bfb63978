/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/hotplug.h"

#include <errno.h>
#include <linux/netlink.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* Multicast groups of NETLINK_KOBJECT_UEVENT, as bits. Only root may send to either. */
#define KERNEL_EVENTS (1U << 0)
#define UDEV_EVENTS (1U << 1)
#define EVENT_BYTES 8192

/* What udevd's events begin with (libudev-monitor.c of systemd); the properties lie further on. */
struct udev_header {
	char prefix[8]; /* "libudev" */
	uint32_t magic, header_bytes, properties_offset, properties_bytes;
};

int lp_v4l2_hotplug_open(void)
{
	const struct sockaddr_nl address = {.nl_family = AF_NETLINK,
					    .nl_groups = KERNEL_EVENTS | UDEV_EVENTS};
	const int fd = socket(AF_NETLINK, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK,
			      NETLINK_KOBJECT_UEVENT);

	if (fd < 0)
		return -errno;
	if (bind(fd, (const struct sockaddr *)&address, sizeof(address)) < 0) {
		const int ret = -errno;

		close(fd);
		return ret;
	}
	return fd;
}

/* Where the zero-terminated KEY=VALUE texts of an event begin. The kernel's follow a text
 * "add@/devices/.../video0". */
static size_t properties_offset(const char *event, size_t size_bytes)
{
	struct udev_header header;

	if (size_bytes < sizeof(header) || memcmp(event, "libudev", 8) != 0)
		return strnlen(event, size_bytes);
	memcpy(&header, event, sizeof(header));
	return header.properties_offset < size_bytes ? header.properties_offset : size_bytes;
}

bool lp_v4l2_hotplug_is_news(const char *event, size_t size_bytes)
{
	bool is_video = false, is_removed = false;

	for (size_t at = properties_offset(event, size_bytes); at < size_bytes;) {
		const size_t length = strnlen(event + at, size_bytes - at);

		is_video |= length == strlen("SUBSYSTEM=video4linux") &&
			    memcmp(event + at, "SUBSYSTEM=video4linux", length) == 0;
		is_removed |= length == strlen("ACTION=remove") &&
			      memcmp(event + at, "ACTION=remove", length) == 0;
		at += length + 1;
	}
	return is_video && !is_removed;
}

bool lp_v4l2_hotplug_read(int fd)
{
	char event[EVENT_BYTES];
	bool found = false;
	ssize_t size;

	/* ENOBUFS: events were lost, the node's perhaps. */
	while ((size = recv(fd, event, sizeof(event), 0)) > 0 || (size < 0 && errno == ENOBUFS))
		found |= size < 0 || lp_v4l2_hotplug_is_news(event, (size_t)size);
	return found;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/v4l2/hotplug.h"

#include <errno.h>
#include <linux/netlink.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define KERNEL_EVENTS 1 /* multicast group; 2 is udevd's */
#define EVENT_BYTES 8192

int lp_v4l2_hotplug_open(void)
{
	const struct sockaddr_nl address = {.nl_family = AF_NETLINK, .nl_groups = KERNEL_EVENTS};
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

/* An event is "add@/devices/.../video0", then zero-terminated KEY=VALUE texts. */
static bool is_new_video_node(const char *event, size_t size_bytes)
{
	const char *const end = event + size_bytes;

	if (strncmp(event, "add@", 4) != 0)
		return false;
	for (const char *text = event; text < end; text += strlen(text) + 1) {
		if (strcmp(text, "SUBSYSTEM=video4linux") == 0)
			return true;
	}
	return false;
}

bool lp_v4l2_hotplug_read(int fd)
{
	char event[EVENT_BYTES + 1];
	bool found = false;
	ssize_t size;

	/* ENOBUFS: events were lost, the node's perhaps. */
	while ((size = recv(fd, event, EVENT_BYTES, 0)) > 0 || (size < 0 && errno == ENOBUFS)) {
		if (size < 0) {
			found = true;
			continue;
		}
		event[size] = '\0';
		found |= is_new_video_node(event, (size_t)size);
	}
	return found;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* can:INTERFACE — messages as CAN frames, through SocketCAN. */
#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/loop.h"
#include "drivers/link/carrier.h"

#define CAN_BASE 0x500 /* identifier of id 0 */
#define FROM_MCU 0x540 /* identifiers 0x540..0x57F */
#define FROM_MASK 0x7C0
#define FRAMES_AT_ONCE 64
#define BUS_OFF "can-bus-off"

struct link_can {
	struct lp_link base;
	char interface[IFNAMSIZ];
	struct lp_watch watch;
	bool bus_off;
};

static struct link_can *self_of(const struct lp_link *link)
{
	return (struct link_can *)link;
}

static void set_bus_off(struct link_can *self, bool bus_off)
{
	const struct lp_link_host *host = &self->base.host;

	if (bus_off == self->bus_off)
		return;
	self->bus_off = bus_off;
	host->fault(host->context, BUS_OFF,
		    bus_off ? "bus off — check wiring, terminators and bit rate; then set the "
			      "interface down and up with ip link (or give it restart-ms)"
			    : NULL);
}

static const char *why(int error)
{
	return error == ENETDOWN ? "the interface is down — run ip link set INTERFACE up type can "
				   "bitrate 500000"
	       : error == ENODEV ? "the interface is gone — is it plugged in?"
				 : lp_strerror(error);
}

static void take_frame(struct link_can *self, const struct can_frame *frame, int64_t t_ns)
{
	const struct lp_link_host *host = &self->base.host;
	struct lp_link_message message = {0};

	if (frame->can_id & CAN_ERR_FLAG) {
		if (frame->can_id & (CAN_ERR_BUSOFF | CAN_ERR_RESTARTED))
			set_bus_off(self, frame->can_id & CAN_ERR_BUSOFF);
		return;
	}
	set_bus_off(self, false);
	message.id = (uint8_t)((frame->can_id & CAN_SFF_MASK) - CAN_BASE);
	message.length_bytes = frame->can_dlc;
	if ((frame->can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG)) ||
	    lp_link_length(message.id) != frame->can_dlc)
		return;
	memcpy(message.payload, frame->data, frame->can_dlc);
	host->received(host->context, &message, t_ns);
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct link_can *self = LP_CONTAINER_OF(watch, struct link_can, watch);
	const struct lp_link_host *host = &self->base.host;

	(void)events;
	for (int i = 0; i < FRAMES_AT_ONCE && watch->fd >= 0; i++) {
		struct can_frame frame;
		const ssize_t got = recv(watch->fd, &frame, sizeof(frame), MSG_DONTWAIT);

		if (got == sizeof(frame)) {
			take_frame(self, &frame, lp_clock_ns());
		} else {
			if (got < 0 && errno != EAGAIN && errno != EINTR) {
				const char *const reason = why(errno);

				set_bus_off(self, false); /* the interface starts anew */
				host->lost(host->context, "receive", reason);
			}
			return;
		}
	}
}

static void can_close(struct lp_link *link)
{
	struct link_can *self = self_of(link);
	const int fd = self->watch.fd;

	if (fd < 0)
		return;
	lp_watch_stop(&self->watch);
	close(fd); /* a bus that is off stays so, and does not say so again */
}

static int bind_to(const struct link_can *self, int fd)
{
	const struct can_filter filter = {.can_id = FROM_MCU,
					  .can_mask = FROM_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG};
	const can_err_mask_t errors = CAN_ERR_BUSOFF | CAN_ERR_RESTARTED;
	struct sockaddr_can address = {.can_family = AF_CAN};
	struct ifreq request = {0};

	memcpy(request.ifr_name, self->interface, sizeof(request.ifr_name));
	if (ioctl(fd, SIOCGIFINDEX, &request) < 0)
		return -errno;
	address.can_ifindex = request.ifr_ifindex;
	if (ioctl(fd, SIOCGIFFLAGS, &request) < 0)
		return -errno;
	if (!(request.ifr_flags & IFF_UP))
		return -ENETDOWN;
	if (setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof(filter)) < 0 ||
	    setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof(errors)) < 0 ||
	    bind(fd, (const struct sockaddr *)&address, sizeof(address)) < 0)
		return -errno;
	return 0;
}

static int can_open(struct lp_link *link, const char **reason)
{
	struct link_can *self = self_of(link);
	const int fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
	int ret = fd < 0 ? -errno : bind_to(self, fd);

	if (ret == 0)
		ret = lp_watch_start(link->host.loop, &self->watch, fd, LP_READABLE, on_ready);
	if (ret == 0)
		return 0;
	*reason = ret == -EAFNOSUPPORT ? "CAN sockets are not available — run modprobe can-raw; a "
					 "service needs its drop-in can.conf"
				       : why(-ret);
	if (fd >= 0)
		close(fd);
	return ret;
}

static int can_send(struct lp_link *link, const struct lp_link_message *message)
{
	struct link_can *self = self_of(link);
	struct can_frame frame = {.can_id = CAN_BASE + message->id,
				  .can_dlc = message->length_bytes};

	if (self->watch.fd < 0)
		return -EAGAIN;
	memcpy(frame.data, message->payload, message->length_bytes);
	/* A full queue, a bus that is off: the message is lost, and asked for again. */
	return send(self->watch.fd, &frame, sizeof(frame), MSG_DONTWAIT) < 0 ? -EAGAIN : 0;
}

static void can_destroy(struct lp_link *link)
{
	can_close(link);
	free(link);
}

static int can_create(const char *device, const struct lp_link_settings *settings,
		      const struct lp_link_host *host, struct lp_link **link)
{
	struct link_can *self;

	(void)settings;
	if (strlen(device) >= sizeof(self->interface))
		return -ENAMETOOLONG;
	self = calloc(1, sizeof(*self));
	if (!self)
		return -ENOMEM;
	self->base = (struct lp_link){.ops = &lp_link_can_ops, .host = *host};
	memcpy(self->interface, device, strlen(device) + 1);
	self->watch.fd = -1;
	*link = &self->base;
	return 0;
}

const struct lp_link_ops lp_link_can_ops = {
	.scheme = "can",
	.create = can_create,
	.open = can_open,
	.send = can_send,
	.close = can_close,
	.destroy = can_destroy,
};

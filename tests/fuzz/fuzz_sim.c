/* SPDX-License-Identifier: Apache-2.0 */
/* What a simulator may send: the bytes go through a real socket into the source. */
#include "fuzz.h"

#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "app/backends.h"
#include "base/log.h"
#include "base/loop.h"
#include "include/frame.h"
#include "include/source.h"

static void on_frame(void *context, struct lp_frame *frame)
{
	uint8_t sum = 0;

	(void)context;
	for (size_t i = 0; i < frame->size_bytes; i += 64)
		sum ^= frame->data[i];
	fuzz_assert(frame->width_px > 0 && frame->height_px > 0);
	fuzz_assert(frame->t_arrival_ns > 0);
	frame->gain += sum; /* the bytes are there */
	lp_frame_release(frame);
}

static void on_corrupt(void *context)
{
	(void)context;
}

static void on_fault(void *context, const char *id, const char *text)
{
	(void)context;
	fuzz_assert(*id != '\0' && (!text || *text != '\0'));
}

static void on_state(void *context, enum lp_source_state state, const char *reason)
{
	(void)reason;
	*(enum lp_source_state *)context = state;
}

/* One listening socket for the life of the process. */
static int listener(const char *path)
{
	static int fd = -1;
	struct sockaddr_un address = {.sun_family = AF_UNIX};

	if (fd >= 0)
		return fd;
	fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	memcpy(address.sun_path, path, strlen(path) + 1);
	unlink(path);
	fuzz_assert(bind(fd, (struct sockaddr *)&address, sizeof(address)) == 0);
	fuzz_assert(listen(fd, 4) == 0);
	return fd;
}

/* The source connects in its first turns of the loop. */
static int accept_source(int listening, struct lp_loop *loop)
{
	int peer;

	do {
		(void)lp_loop_run_once(loop);
		peer = accept4(listening, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
	} while (peer < 0);
	return peer;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	enum lp_source_state state = 0;
	struct lp_source_host host = {.context = &state,
				      .frame = on_frame,
				      .corrupt = on_corrupt,
				      .state = on_state,
				      .fault = on_fault};
	struct lp_source *source;
	char uri[64];
	int listening, peer;

	lp_log_set_level(LP_LOG_ERROR);
	(void)snprintf(uri, sizeof(uri), "sim:/tmp/lp-fuzz-%d.sock", (int)getpid());
	listening = listener(uri + 4);
	fuzz_assert(lp_loop_create(&host.loop) == 0);
	fuzz_assert(lp_source_open(uri, &host, &source) == 0);
	fuzz_assert(source->ops->start(source) == 0);
	peer = accept_source(listening, host.loop);
	/* More than the socket holds is cut off: a simulator that dies. */
	(void)!send(peer, data, size, MSG_DONTWAIT | MSG_NOSIGNAL);
	(void)shutdown(peer, SHUT_WR);
	while (state != LP_SOURCE_WAITING)
		(void)lp_loop_run_once(host.loop);
	close(peer);
	source->ops->destroy(source);
	lp_loop_destroy(host.loop);
	return 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A camera that follows Open Spherical Camera, as little of it as a source needs: one thread per
 * connection, and a live preview into which the test puts the pictures. The camera with all its
 * moods is the Python simulator (tests/e2e/test_osc.py).
 */
#ifndef LP_FAKE_OSC_H
#define LP_FAKE_OSC_H

#include <arpa/inet.h>
#include <netinet/in.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "jpeg_encode.h"

#define FAKE_OSC_WIDTH_PX 64
#define FAKE_OSC_HEIGHT_PX 32
#define FAKE_OSC_CONNECTIONS 16

static struct {
	pthread_mutex_t lock;
	pthread_t acceptor;
	int listener; /* -1: unplugged */
	uint16_t port;
	int live; /* the connection of the live preview; -1: none */
	int connections[FAKE_OSC_CONNECTIONS];
	int threads;	    /* that serve one */
	char exposure[200]; /* the last command that set a shutter speed */
	uint8_t *jpeg;
	unsigned long jpeg_bytes;
} fake_osc = {.lock = PTHREAD_MUTEX_INITIALIZER, .listener = -1, .live = -1};

static inline void fake_osc_write(int fd, const void *data, size_t size_bytes)
{
	(void)send(fd, data, size_bytes, MSG_NOSIGNAL);
}

static inline const char *fake_osc_answer(const char *request)
{
	if (strstr(request, "GET /osc/info"))
		return "{\"manufacturer\":\"RICOH\",\"model\":\"FAKE\",\"serialNumber\":\"1\","
		       "\"firmwareVersion\":\"1\",\"apiLevel\":[2]}";
	if (strstr(request, "/osc/state"))
		return "{\"fingerprint\":\"1\",\"state\":{\"batteryLevel\":1.0}}";
	if (strstr(request, "previewFormatSupport"))
		return "{\"results\":{\"options\":{\"previewFormatSupport\":"
		       "[{\"width\":64,\"height\":32,\"framerate\":100}]}}}";
	if (strstr(request, "exposureProgramSupport"))
		return "{\"results\":{\"options\":{\"exposureProgram\":2,"
		       "\"exposureProgramSupport\":[1,2],\"shutterSpeed\":0,\"iso\":0}}}";
	if (strstr(request, "shutterSpeedSupport"))
		return "{\"results\":{\"options\":{\"isoSupport\":[100,200],"
		       "\"shutterSpeedSupport\":[0.004,0.001,0.002,1]}}}";
	if (strstr(request, "getOptions"))
		return "{\"results\":{\"options\":{\"captureMode\":\"video\"}}}";
	if (strstr(request, "setOptions"))
		return "{\"state\":\"done\"}";
	return "{\"error\":{\"code\":\"unknownCommand\",\"message\":\"fake\"}}";
}

/* Read one request whole. False: the other end has gone. */
static inline bool fake_osc_read(int fd, char *request, size_t size_bytes)
{
	size_t used = 0;

	for (;;) {
		const ssize_t got = recv(fd, request + used, size_bytes - 1 - used, 0);
		const char *end, *length;

		if (got <= 0)
			return false;
		used += (size_t)got;
		request[used] = '\0';
		end = strstr(request, "\r\n\r\n");
		length = strstr(request, "Content-Length: ");
		if (end && (!length || used - (size_t)(end + 4 - request) >=
					       (size_t)strtoul(length + 16, NULL, 10)))
			return true;
	}
}

static inline void fake_osc_forget(int fd)
{
	pthread_mutex_lock(&fake_osc.lock);
	for (int i = 0; i < FAKE_OSC_CONNECTIONS; i++) {
		if (fake_osc.connections[i] == fd)
			fake_osc.connections[i] = 0;
	}
	if (fake_osc.live == fd)
		fake_osc.live = -1;
	close(fd);
	fake_osc.threads--;
	pthread_mutex_unlock(&fake_osc.lock);
}

static inline void fake_osc_begin_live(int fd)
{
	static const char head[] = "HTTP/1.1 200 OK\r\nConnection: close\r\nContent-Type: "
				   "multipart/x-mixed-replace; boundary=\"fake-osc-next\"\r\n\r\n";
	char byte;

	fake_osc_write(fd, head, strlen(head));
	pthread_mutex_lock(&fake_osc.lock);
	fake_osc.live = fd;
	pthread_mutex_unlock(&fake_osc.lock);
	(void)recv(fd, &byte, 1, 0); /* until the other end goes */
}

static inline void *fake_osc_serve(void *argument)
{
	const int fd = (int)(intptr_t)argument;
	char request[4096], head[160];

	while (fake_osc_read(fd, request, sizeof(request))) {
		const char *answer = fake_osc_answer(request);

		if (strstr(request, "getLivePreview")) {
			fake_osc_begin_live(fd);
			break;
		}
		pthread_mutex_lock(&fake_osc.lock);
		if (strstr(request, "\"shutterSpeed\":"))
			(void)snprintf(fake_osc.exposure, sizeof(fake_osc.exposure), "%s",
				       strstr(request, "\"shutterSpeed\":"));
		pthread_mutex_unlock(&fake_osc.lock);
		(void)snprintf(head, sizeof(head),
			       "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
			       "Content-Length: %zu\r\n\r\n",
			       strlen(answer));
		fake_osc_write(fd, head, strlen(head));
		fake_osc_write(fd, answer, strlen(answer));
	}
	fake_osc_forget(fd);
	return NULL;
}

static inline void *fake_osc_accept(void *argument)
{
	const int listener = (int)(intptr_t)argument;
	int fd;

	while ((fd = accept(listener, NULL, NULL)) >= 0) {
		pthread_t thread;

		pthread_mutex_lock(&fake_osc.lock);
		for (int i = 0; i < FAKE_OSC_CONNECTIONS; i++) {
			if (fake_osc.connections[i] == 0) {
				fake_osc.connections[i] = fd;
				break;
			}
		}
		fake_osc.threads++;
		pthread_mutex_unlock(&fake_osc.lock);
		assert_int_equal(pthread_create(&thread, NULL, fake_osc_serve,
						(void *)(intptr_t)fd),
				 0);
		pthread_detach(thread);
	}
	return NULL;
}

static inline void fake_osc_plug(void)
{
	static const struct jpeg_kind kind = {.components = 3, .h = 2, .v = 2, .quality = 50};
	struct sockaddr_in address = {.sin_family = AF_INET,
				      .sin_addr = {htonl(INADDR_LOOPBACK)},
				      .sin_port = htons(fake_osc.port)};
	socklen_t length = sizeof(address);
	const int on = 1;

	if (!fake_osc.jpeg)
		fake_osc.jpeg = encode_jpeg(&kind, FAKE_OSC_WIDTH_PX, FAKE_OSC_HEIGHT_PX,
					    &fake_osc.jpeg_bytes);
	fake_osc.listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
	(void)setsockopt(fake_osc.listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
	assert_int_equal(bind(fake_osc.listener, (struct sockaddr *)&address, length), 0);
	assert_int_equal(listen(fake_osc.listener, 8), 0);
	assert_int_equal(getsockname(fake_osc.listener, (struct sockaddr *)&address, &length), 0);
	fake_osc.port = ntohs(address.sin_port);
	assert_int_equal(pthread_create(&fake_osc.acceptor, NULL, fake_osc_accept,
					(void *)(intptr_t)fake_osc.listener),
			 0);
}

/* Every connection breaks, and no other is accepted. */
static inline void fake_osc_unplug(void)
{
	bool busy = true;

	if (fake_osc.listener < 0)
		return;
	(void)shutdown(fake_osc.listener, SHUT_RDWR);
	pthread_join(fake_osc.acceptor, NULL);
	close(fake_osc.listener);
	fake_osc.listener = -1;
	while (busy) {
		pthread_mutex_lock(&fake_osc.lock);
		for (int i = 0; i < FAKE_OSC_CONNECTIONS; i++) {
			if (fake_osc.connections[i] > 0)
				(void)shutdown(fake_osc.connections[i], SHUT_RDWR);
		}
		busy = fake_osc.threads > 0;
		pthread_mutex_unlock(&fake_osc.lock);
		usleep(1000);
	}
}

/* Put bytes into the live preview. False: there is none yet. */
static inline bool fake_osc_put(const void *data, size_t size_bytes)
{
	bool is_live;

	pthread_mutex_lock(&fake_osc.lock);
	is_live = fake_osc.live >= 0;
	if (is_live)
		fake_osc_write(fake_osc.live, data, size_bytes);
	pthread_mutex_unlock(&fake_osc.lock);
	return is_live;
}

/* A picture, whole or cut off. */
static inline bool fake_osc_send(bool corrupt)
{
	static uint8_t part[8192];
	/* A picture that is cut off ends with the next boundary. */
	const char *const tail = corrupt ? "\r\n--fake-osc-next\r\n" : "\r\n";
	const size_t bytes = corrupt ? fake_osc.jpeg_bytes / 2 : fake_osc.jpeg_bytes;
	const size_t head =
		(size_t)snprintf((char *)part, sizeof(part),
				 "--fake-osc-next\r\nContent-Length: %zu\r\n\r\n", bytes);

	assert_true(head + bytes + strlen(tail) < sizeof(part));
	memcpy(part + head, fake_osc.jpeg, bytes);
	memcpy(part + head + bytes, tail, strlen(tail));
	return fake_osc_put(part, head + bytes + strlen(tail));
}

#endif

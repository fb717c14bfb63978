/* SPDX-License-Identifier: Apache-2.0 */
/*
 * An I2C bus, /dev/i2c-fake, made by the test: open() and ioctl() end here (the linker's --wrap,
 * tests/tests.mk). It can hang, as a bus whose clock is held low does. For real adapters:
 * tests/kernel.
 */
#ifndef LP_FAKE_I2C_H
#define LP_FAKE_I2C_H

#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <sys/eventfd.h>

#define FAKE_I2C "/dev/i2c-fake"

static struct {
	pthread_mutex_t lock;
	pthread_cond_t changed;
	int fd; /* of whoever opened it last; -1: nobody */
	int opened;
	bool hangs;		/* a transfer begun meanwhile waits until it is false again */
	int hanging;		/* so many transfers wait */
	int error;		/* errno of every transfer; 0: they succeed */
	int writes;		/* transfers so far */
	uint8_t last[32];	/* bytes of the last one */
	uint8_t registers[256]; /* of a chip whose first byte written is the register's number */
	/* The test's own chips, called with the lock held: 0 or -errno; NULL: the chip above. */
	int (*chips)(const struct i2c_rdwr_ioctl_data *request);
} fake_i2c = {.lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER, .fd = -1};

/* A value of the bus, set while a thread may look at it. */
#define FAKE_I2C_SET(field, value)                         \
	do {                                               \
		pthread_mutex_lock(&fake_i2c.lock);        \
		fake_i2c.field = (value);                  \
		pthread_cond_broadcast(&fake_i2c.changed); \
		pthread_mutex_unlock(&fake_i2c.lock);      \
	} while (0)

static inline int fake_i2c_get(const int *field)
{
	int value;

	pthread_mutex_lock(&fake_i2c.lock);
	value = *field;
	pthread_mutex_unlock(&fake_i2c.lock);
	return value;
}

static inline void fake_i2c_init(void)
{
	fake_i2c.fd = -1;
	fake_i2c.opened = fake_i2c.hanging = fake_i2c.error = fake_i2c.writes = 0;
	fake_i2c.hangs = false;
	memset(fake_i2c.registers, 0, sizeof(fake_i2c.registers));
}

/* Reads give zeros: a mailbox without mail. */
static int fake_i2c_transfer(const struct i2c_rdwr_ioctl_data *request)
{
	const struct i2c_msg *message = request->msgs;

	fake_i2c.hanging++;
	while (fake_i2c.hangs)
		pthread_cond_wait(&fake_i2c.changed, &fake_i2c.lock);
	fake_i2c.hanging--;
	if (fake_i2c.error)
		return -fake_i2c.error;
	if (fake_i2c.chips)
		return fake_i2c.chips(request);
	if (message->flags & I2C_M_RD) {
		memset(message->buf, 0, message->len);
		return 0;
	}
	fake_i2c.writes++;
	memcpy(fake_i2c.last, message->buf,
	       message->len < sizeof(fake_i2c.last) ? message->len : sizeof(fake_i2c.last));
	for (int i = 1; i < message->len; i++)
		fake_i2c.registers[(uint8_t)(message->buf[0] + i - 1)] = message->buf[i];
	return 0;
}

int __real_open(const char *path, int flags, ...);
int __wrap_open(const char *path, int flags, ...);
int __real_ioctl(int fd, unsigned long request, ...);
int __wrap_ioctl(int fd, unsigned long request, ...);

int __wrap_open(const char *path, int flags, ...)
{
	va_list arguments;
	int mode, fd;

	va_start(arguments, flags);
	mode = flags & O_CREAT ? va_arg(arguments, int) : 0;
	va_end(arguments);
	if (strcmp(path, FAKE_I2C) != 0)
		return __real_open(path, flags, mode);
	fd = eventfd(0, EFD_CLOEXEC);
	FAKE_I2C_SET(fd, fd);
	FAKE_I2C_SET(opened, fake_i2c.opened + 1);
	return fd;
}

int __wrap_ioctl(int fd, unsigned long request, ...)
{
	va_list arguments;
	void *argument;
	int ret = 0;

	va_start(arguments, request);
	argument = va_arg(arguments, void *);
	va_end(arguments);
	if (request != I2C_RDWR && request != I2C_FUNCS && request != I2C_TIMEOUT)
		return __real_ioctl(fd, request, argument);
	pthread_mutex_lock(&fake_i2c.lock);
	if (request == I2C_FUNCS)
		*(unsigned long *)argument = I2C_FUNC_I2C;
	else if (request == I2C_RDWR)
		ret = fake_i2c_transfer(argument);
	pthread_mutex_unlock(&fake_i2c.lock);
	errno = -ret;
	return ret < 0 ? -1 : 0;
}

#endif

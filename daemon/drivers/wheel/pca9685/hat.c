/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/wheel/pca9685/hat.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <math.h>
#include <poll.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/loop.h"
#include "drivers/link/bus_thread.h"
#include "drivers/wheel/guard.h"

/* Registers, NXP's data sheet of the PCA9685, section 7.3. */
#define MODE1 0x00
#define MODE1_SLEEP 0x10
#define MODE1_INCREMENT 0x20
#define LED0 0x06
#define FULL_OFF 0x10
#define PRE_SCALE 0xFE
#define PRE_SCALE_50_HZ 121 /* 25 MHz / 4096 / 50 Hz - 1 */
#define COUNTS_PER_US (4096 * 50 / 1e6F)
#define BUS_TIMEOUT_10MS 1
#define HANGS_NS (500 * LP_NS_PER_MS) /* without an answer of the thread */
#define LET_GO_MS 1000

enum stage { OPENED, GUARDED, SET_UP, WRITTEN };

/* From the thread to the loop: it has come so far, or failed there. */
struct answer {
	enum stage stage;
	int error; /* 0 or -errno */
};

/* The thread's own. */
struct chip {
	struct lp_servo_hat_settings settings;
	int bus_fd;   /* -1: not open */
	int guard_fd; /* ends the pulses should this program die; -1: none */
};

struct lp_servo_hat {
	struct lp_servo_hat_settings settings;
	struct lp_servo_hat_host host;
	struct lp_watch watch;
	struct lp_bus_thread *thread; /* NULL: none yet; watch.fd -1: it is to end */
	int64_t answered_ns;
};

/* ---------------------------------------------------------------- the thread */

/* 0 or -errno. Safe after fork(), as write_pulse() is. */
static int write_registers(const struct chip *chip, uint8_t *bytes, uint16_t count)
{
	struct i2c_msg message = {.addr = (uint16_t)chip->settings.address,
				  .len = count,
				  .buf = bytes};
	struct i2c_rdwr_ioctl_data request = {.msgs = &message, .nmsgs = 1};

	return ioctl(chip->bus_fd, I2C_RDWR, &request) < 0 ? -errno : 0;
}

static int write_register(const struct chip *chip, uint8_t number, uint8_t value)
{
	return write_registers(chip, (uint8_t[]){number, value}, 2);
}

/* 0: no pulse; the model gives no other outside of the servo's limits. */
static int write_pulse(const struct chip *chip, float pulse_us)
{
	const uint16_t off = (uint16_t)lrintf(pulse_us * COUNTS_PER_US);

	return write_registers(chip,
			       (uint8_t[]){(uint8_t)(LED0 + 4 * chip->settings.channel), 0, 0,
					   (uint8_t)(off & 0xFF),
					   off ? (uint8_t)(off >> 8) : FULL_OFF},
			       5);
}

/* The pre-scaler can be set only while the chip sleeps. */
static int set_up(const struct chip *chip)
{
	int ret = write_register(chip, MODE1, MODE1_SLEEP | MODE1_INCREMENT);

	if (ret == 0)
		ret = write_register(chip, PRE_SCALE, PRE_SCALE_50_HZ);
	if (ret == 0)
		ret = write_pulse(chip, 0);
	if (ret == 0)
		ret = write_register(chip, MODE1, MODE1_INCREMENT);
	return ret;
}

/* Report a step to the loop. Returns `error`. */
static int answer(int fd, enum stage stage, int error)
{
	const struct answer message = {.stage = stage, .error = error};

	(void)send(fd, &message, sizeof(message), MSG_NOSIGNAL);
	return error;
}

/* In the guard's process: the chip would go on sending its last pulse for ever. */
static void end_pulses(int bus_fd, const void *context)
{
	(void)bus_fd; /* the chip's own, still open there */
	(void)write_pulse(context, 0);
}

static int open_chip(struct chip *chip, int fd)
{
	int ret;

	chip->bus_fd = open(chip->settings.device, O_RDWR | O_CLOEXEC);
	if (chip->bus_fd < 0)
		return answer(fd, OPENED, -errno);
	(void)ioctl(chip->bus_fd, I2C_TIMEOUT, BUS_TIMEOUT_10MS);
	ret = set_up(chip);
	if (ret < 0)
		return answer(fd, SET_UP, ret);
	chip->guard_fd = lp_guard_start(chip->bus_fd, end_pulses, chip);
	if (chip->guard_fd < 0)
		return answer(fd, GUARDED, chip->guard_fd);
	return answer(fd, SET_UP, 0);
}

/* The newest pulse that the loop has sent. False: none has come. */
static bool take_newest(int fd, float *pulse_us)
{
	bool taken = false;

	while (recv(fd, pulse_us, sizeof(*pulse_us), MSG_DONTWAIT) == sizeof(*pulse_us))
		taken = true;
	return taken;
}

static void run(void *context, int fd)
{
	struct chip *chip = context;
	struct pollfd waiting = {.fd = fd, .events = POLLIN};
	bool works = open_chip(chip, fd) == 0;

	for (;;) {
		float pulse_us;

		if (!works)
			waiting.events = 0; /* wait for the end only */
		(void)poll(&waiting, 1, -1);
		if (waiting.revents & (POLLHUP | POLLERR))
			break;
		if (take_newest(fd, &pulse_us))
			works = answer(fd, WRITTEN, write_pulse(chip, pulse_us)) == 0;
	}
	if (chip->bus_fd >= 0)
		(void)write_pulse(chip, 0);
}

static void finish(void *context)
{
	struct chip *chip = context;

	lp_guard_release(chip->guard_fd);
	if (chip->bus_fd >= 0)
		close(chip->bus_fd);
	free(chip);
}

/* ---------------------------------------------------------------- the loop */

static void fail(struct lp_servo_hat *hat, enum stage stage, int error)
{
	static const char *const names[] = {
		[OPENED] = "open", [GUARDED] = "guard", [SET_UP] = "set up", [WRITTEN] = "write"};

	hat->host.failed(hat->host.context, names[stage], error);
}

static void on_ready(struct lp_watch *watch, unsigned int events)
{
	struct lp_servo_hat *hat = LP_CONTAINER_OF(watch, struct lp_servo_hat, watch);
	struct answer message;

	(void)events;
	if (recv(watch->fd, &message, sizeof(message), MSG_DONTWAIT) != sizeof(message))
		return;
	hat->answered_ns = lp_clock_ns();
	if (message.error < 0)
		fail(hat, message.stage, message.error);
	else if (message.stage == SET_UP)
		hat->host.ready(hat->host.context);
}

struct lp_servo_hat *lp_servo_hat_create(const struct lp_servo_hat_settings *settings,
					 const struct lp_servo_hat_host *host)
{
	struct lp_servo_hat *hat = calloc(1, sizeof(*hat));

	if (!hat)
		return NULL;
	hat->settings = *settings;
	hat->host = *host;
	hat->watch.fd = -1;
	return hat;
}

int lp_servo_hat_open(struct lp_servo_hat *hat)
{
	struct lp_bus_job job = {.run = run, .finish = finish};
	struct chip *chip;
	int ret;

	if (hat->thread && !lp_bus_thread_has_ended(hat->thread))
		return -EBUSY;
	lp_bus_thread_destroy(hat->thread, 0);
	hat->thread = NULL;
	chip = calloc(1, sizeof(*chip));
	if (!chip)
		return -ENOMEM;
	*chip = (struct chip){.settings = hat->settings, .bus_fd = -1, .guard_fd = -1};
	job.context = chip;
	ret = lp_bus_thread_start(&job, &hat->thread);
	if (ret < 0) {
		free(chip);
		return ret;
	}
	ret = lp_watch_start(hat->host.loop, &hat->watch, lp_bus_thread_fd(hat->thread),
			     LP_READABLE, on_ready);
	if (ret < 0)
		lp_bus_thread_end(hat->thread);
	hat->answered_ns = lp_clock_ns();
	return ret;
}

void lp_servo_hat_pulse(struct lp_servo_hat *hat, float pulse_us)
{
	if (hat->watch.fd < 0)
		return;
	/* A full socket: the thread hangs, and the newest pulse will be another one. */
	(void)send(hat->watch.fd, &pulse_us, sizeof(pulse_us), MSG_NOSIGNAL | MSG_DONTWAIT);
	if (lp_clock_ns() - hat->answered_ns > HANGS_NS)
		fail(hat, WRITTEN, -ETIMEDOUT);
}

void lp_servo_hat_close(struct lp_servo_hat *hat)
{
	if (hat->watch.fd < 0)
		return;
	lp_watch_stop(&hat->watch);
	lp_bus_thread_end(hat->thread);
}

void lp_servo_hat_destroy(struct lp_servo_hat *hat)
{
	if (!hat)
		return;
	lp_servo_hat_close(hat);
	lp_bus_thread_destroy(hat->thread, LET_GO_MS);
	free(hat);
}

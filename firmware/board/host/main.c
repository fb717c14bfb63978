/* SPDX-License-Identifier: Apache-2.0 */
/* The firmware as a Linux process: on a pty, paced by the wall clock, or in lock-step. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "board/host/console.h"
#include "board/host/frame_log.h"
#include "board/host/host.h"
#include "board/host/line.h"
#include "firmware.h"

#define POLL_US 500

struct process {
	struct firmware firmware;
	bool started; /* not in the boot loader's hands */
	struct console console;
	struct frame_log log;
	struct line line;
	const char *eeprom;
};

static void usage(void)
{
	puts("usage: lightprobe-mcu-host [--lock-step] [--pty PATH] [options]\n"
	     "The microcontroller's firmware as a process, with a simulated wheel and ring.\n"
	     "  --pty PATH      symbolic link to make: the serial line\n"
	     "  --lock-step     time passes only in `run`; else it is the wall clock's, and\n"
	     "                  needs --pty\n"
	     "  --control PATH  Unix socket for commands; else stdin and stdout\n"
	     "  --eeprom FILE   keep the parameters there\n"
	     "  --seed N        of the simulated noise\n"
	     "Commands, one a line, each with one answer:\n"
	     "  set NAME VALUE, get NAME, names   numbers of the box: board/host/world.h\n"
	     "  angles FROM_NS TO_NS COUNT        where the wheel was, by CLOCK_MONOTONIC\n"
	     "  run US          let time pass (lock-step)\n"
	     "  flush           send what the firmware has put on the line (lock-step)\n"
	     "  tx HEX          bytes to the firmware\n"
	     "  frames          frames from it: count, then lines of time, least and\n"
	     "                  greatest wheel angle of the 2 ms before, bytes\n"
	     "  eeprom [HEX]    read all, or write from 0\n"
	     "  worn ADDRESS BITS   of this EEPROM byte these bits keep what they hold\n"
	     "  time, reset, quit");
}

static void save_eeprom(const char *path)
{
	FILE *file = path ? fopen(path, "wb") : NULL;

	if (path &&
	    (!file || fwrite(host.eeprom, 1, sizeof(host.eeprom), file) != sizeof(host.eeprom)))
		perror(path);
	if (file)
		fclose(file);
}

static void load_eeprom(const char *path)
{
	FILE *file = path ? fopen(path, "rb") : NULL;

	if (!file)
		return; /* a new chip */
	if (fread(host.eeprom, 1, sizeof(host.eeprom), file) != sizeof(host.eeprom))
		fprintf(stderr, "%s: shorter than an EEPROM: the rest is blank\n", path);
	fclose(file);
}

static void on_out(void *context, const uint8_t *bytes, uint8_t count)
{
	struct process *process = context;

	uint8_t sent[UINT8_MAX];

	for (uint8_t i = 0; i < count; i++)
		frame_log_byte(&process->log, bytes[i], host.t_us, &host.world);
	memcpy(sent, bytes, count);
	size_t left = world_line(&host.world, sent, count);
	line_send(&process->line, sent, left);
}

static void start(struct process *process)
{
	memset(&process->firmware, 0, sizeof(process->firmware));
	process->started = true;
	firmware_start(&process->firmware);
}

static void run_firmware(struct process *process)
{
	if (host.reset_asked) {
		host_boot();
		process->started = false;
	}
	if (host_booting())
		return;
	if (!process->started)
		start(process);
	firmware_poll(&process->firmware);
	board_idle();
}

static void take_line(struct process *process)
{
	uint8_t bytes[512];

	line_plug(&process->line, !host.world.line_unplugged);
	if (process->line.master < 0)
		return;
	if (line_dtr_rose(&process->line) && host.world.dtr_resets)
		board_reset(RESET_CAUSE_EXTERNAL);
	ssize_t got = read(process->line.master, bytes, sizeof(bytes));
	if (got > 0)
		host_send(bytes, (unsigned)world_line(&host.world, bytes, got));
}

static void run_for(struct process *process, int64_t us)
{
	for (; us > 0; us -= POLL_US) {
		if (process->line.path)
			take_line(process);
		host_pass(us < POLL_US ? us : POLL_US);
		run_firmware(process);
	}
}

static void command_tx(struct process *process, const char *hex)
{
	static uint8_t bytes[HOST_LINE_BYTES];
	int count = console_unhex(hex, bytes, sizeof(bytes));

	if (count < 0) {
		console_answer(&process->console, "error: not hexadecimal");
		return;
	}
	host_send(bytes, count);
	console_answer(&process->console, "ok");
}

/* All of it, or written from 0. */
static void command_eeprom(struct process *process, const char *hex)
{
	static uint8_t bytes[HOST_EEPROM_BYTES];
	int count = console_unhex(hex, bytes, sizeof(bytes));

	if (count < 0) {
		console_answer(&process->console, "error: not hexadecimal");
		return;
	}
	memcpy(host.eeprom, bytes, count);
	if (count == 0)
		console_answer_hex(&process->console, host.eeprom, sizeof(host.eeprom));
	else
		console_answer(&process->console, "ok");
}

static void execute(void *context, const char *line)
{
	struct process *process = context;
	struct console *console = &process->console;
	char answer[2048];
	unsigned address, bits;
	unsigned long us;

	if (sscanf(line, "run %lu", &us) == 1) {
		run_for(process, us);
		console_answer(console, "ok");
	} else if (strcmp(line, "flush") == 0) {
		line_flush(&process->line);
		console_answer(console, "ok");
	} else if (strncmp(line, "tx ", 3) == 0) {
		command_tx(process, line + 3);
	} else if (strncmp(line, "eeprom", 6) == 0) {
		command_eeprom(process, line + 6);
	} else if (sscanf(line, "worn %u %u", &address, &bits) == 2) {
		host.worn_address = address % HOST_EEPROM_BYTES;
		host.worn_bits = (uint8_t)bits;
		host.worn_held = host.eeprom[host.worn_address] & host.worn_bits;
		console_answer(console, "ok");
	} else if (strcmp(line, "frames") == 0) {
		frame_log_answer(&process->log, console);
	} else if (strcmp(line, "reset") == 0) {
		board_reset(RESET_CAUSE_EXTERNAL);
		console_answer(console, "ok");
	} else if (strcmp(line, "time") == 0) {
		console_answer(console, "%llu", (unsigned long long)host.t_us);
	} else if (strcmp(line, "quit") == 0) {
		console->closed = true;
		console_answer(console, "ok");
	} else if (world_command(&host.world, line, answer, sizeof(answer))) {
		console_answer(console, "%s", answer);
	} else {
		console_answer(console, "error: unknown command");
	}
}

static int64_t now_us(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return now.tv_sec * 1000000LL + now.tv_nsec / 1000;
}

static void run_real_time(struct process *process)
{
	int64_t offset_us = now_us() - (int64_t)host.t_us;

	while (!process->console.closed) {
		console_serve(&process->console, 1, execute, process);
		int64_t due_us = now_us() - offset_us - (int64_t)host.t_us;
		world_behind(&host.world, due_us);
		if (due_us > WORLD_BEHIND_US) {
			offset_us += due_us - WORLD_BEHIND_US;
			due_us = WORLD_BEHIND_US;
		}
		host.world.start_ns = offset_us * 1000;
		run_for(process, due_us);
	}
	line_plug(&process->line, false);
}

int main(int argc, char **argv)
{
	static struct process process = {.line = LINE_CLOSED};
	bool lock_step = false;
	const char *control = NULL, *pty = NULL;
	uint32_t seed = 1;

	for (int i = 1; i < argc; i++) {
		const char *option = argv[i];
		const char *value = i + 1 < argc ? argv[i + 1] : "";
		if (strcmp(option, "--help") == 0) {
			usage();
			return 0;
		}
		if (strcmp(option, "--lock-step") == 0) {
			lock_step = true;
			continue;
		}
		i++;
		if (strcmp(option, "--pty") == 0)
			pty = value;
		else if (strcmp(option, "--control") == 0)
			control = value;
		else if (strcmp(option, "--eeprom") == 0)
			process.eeprom = value;
		else if (strcmp(option, "--seed") == 0)
			seed = strtoul(value, NULL, 0);
		else {
			fprintf(stderr, "unknown option %s; --help lists them\n", option);
			return 2;
		}
	}
	if (!lock_step && !pty) {
		usage();
		return 2;
	}
	host_init(seed);
	load_eeprom(process.eeprom);
	host.out = on_out;
	host.context = &process;
	console_open(&process.console, control);
	start(&process);
	process.line.path = pty;
	process.line.held = lock_step;
	line_plug(&process.line, true);
	if (!lock_step)
		run_real_time(&process);
	while (!process.console.closed)
		console_serve(&process.console, -1, execute, &process);
	save_eeprom(process.eeprom);
	console_close(&process.console);
	return 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "lp_test.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>

#include "drivers/publisher/queue.h"
#include "include/packet.h"

static int alive;

static void release(struct lp_packet *packet)
{
	alive--;
	free(packet);
}

/* Put a packet full of `letter`; the queue holds the only reference. */
static bool put(struct lp_send_queue *queue, enum lp_packet_kind kind, char letter, uint32_t size)
{
	struct lp_packet *packet = calloc(1, sizeof(*packet) + size);
	bool lost;

	packet->references = 1;
	packet->kind = kind;
	packet->size_bytes = size;
	packet->release = release;
	packet->data = (uint8_t *)(packet + 1);
	memset(packet->data, letter, size);
	alive++;
	lost = lp_send_queue_put(queue, packet);
	lp_packet_drop(packet);
	return lost;
}

static void open_pipe(int fds[2])
{
	assert_int_equal(pipe2(fds, O_NONBLOCK | O_CLOEXEC), 0);
	assert_true(fcntl(fds[1], F_SETPIPE_SZ, 4096) > 0);
}

static void test_pictures_go_last_and_the_newest_only(void **state)
{
	struct lp_send_queue queue = {0};
	char text[16] = {0};
	int fds[2];

	(void)state;
	open_pipe(fds);
	assert_false(put(&queue, LP_PACKET_PICTURE, 'p', 1));
	assert_true(put(&queue, LP_PACKET_PICTURE, 'q', 1));
	assert_false(put(&queue, LP_PACKET_STATE, 'a', 1));
	assert_false(put(&queue, LP_PACKET_CONTROL, 'C', 1));
	assert_false(lp_send_queue_is_empty(&queue));
	assert_int_equal(lp_send_queue_flush(&queue, fds[1]), 0);
	assert_true(lp_send_queue_is_empty(&queue));
	assert_int_equal(alive, 0);
	assert_int_equal(read(fds[0], text, sizeof(text)), 3);
	assert_string_equal(text, "Caq");
	put(&queue, LP_PACKET_PICTURE, 'r', 1);
	lp_send_queue_clear(&queue);
	assert_int_equal(alive, 0);
	close(fds[0]);
	close(fds[1]);
}

static void test_control_before_state_and_newest_state_only(void **state)
{
	struct lp_send_queue queue = {0};
	char text[16] = {0};
	int fds[2];

	(void)state;
	open_pipe(fds);
	assert_true(lp_send_queue_is_empty(&queue));
	assert_false(put(&queue, LP_PACKET_STATE, 'a', 1));
	assert_true(put(&queue, LP_PACKET_STATE, 'b', 1));
	assert_false(put(&queue, LP_PACKET_CONTROL, 'C', 1));
	assert_false(put(&queue, LP_PACKET_CONTROL, 'D', 1));
	assert_int_equal(alive, 3);
	assert_int_equal(lp_send_queue_flush(&queue, fds[1]), 0);
	assert_true(lp_send_queue_is_empty(&queue));
	assert_int_equal(alive, 0);
	assert_int_equal(read(fds[0], text, sizeof(text)), 3);
	assert_string_equal(text, "CDb");
	close(fds[0]);
	close(fds[1]);
}

static void test_control_queue_is_bounded(void **state)
{
	struct lp_send_queue queue = {0};
	char text[16] = {0};
	int fds[2];

	(void)state;
	open_pipe(fds);
	for (char c = 'a'; c < 'a' + LP_QUEUE_CONTROLS; c++)
		assert_false(put(&queue, LP_PACKET_CONTROL, c, 1));
	assert_true(put(&queue, LP_PACKET_CONTROL, 'z', 1));
	assert_int_equal(alive, LP_QUEUE_CONTROLS);
	assert_int_equal(lp_send_queue_flush(&queue, fds[1]), 0);
	assert_int_equal(read(fds[0], text, sizeof(text)), LP_QUEUE_CONTROLS);
	assert_string_equal(text, "bcdefghz");
	close(fds[0]);
	close(fds[1]);
}

/* The packet half sent is finished whole; behind it comes the newest, whole. */
static void test_slow_reader_gets_whole_packets_and_the_newest(void **state)
{
	struct lp_send_queue queue = {0};
	char received[20000];
	size_t size = 0;
	ssize_t got;
	int fds[2], ret;

	(void)state;
	open_pipe(fds);
	for (int i = 0; i < 26; i++) {
		put(&queue, LP_PACKET_STATE, (char)('a' + i), 1500);
		ret = lp_send_queue_flush(&queue, fds[1]);
	}
	assert_int_equal(ret, 1);
	assert_true(alive <= 2);
	do {
		while ((got = read(fds[0], received + size, sizeof(received) - size)) > 0)
			size += (size_t)got;
		ret = lp_send_queue_flush(&queue, fds[1]);
	} while (!lp_send_queue_is_empty(&queue));
	while ((got = read(fds[0], received + size, sizeof(received) - size)) > 0)
		size += (size_t)got;
	assert_int_equal(size % 1500, 0);
	for (size_t at = 0; at < size; at += 1500) {
		for (size_t i = 1; i < 1500; i++)
			assert_int_equal(received[at + i], received[at]);
	}
	assert_int_equal(received[size - 1], 'z');
	assert_true(size < (size_t)26 * 1500);
	assert_int_equal(alive, 0);
	close(fds[0]);
	close(fds[1]);
}

static void test_broken_connection_and_clear(void **state)
{
	struct lp_send_queue queue = {0};
	int fds[2];

	(void)state;
	open_pipe(fds);
	close(fds[0]);
	put(&queue, LP_PACKET_STATE, 'a', 10);
	put(&queue, LP_PACKET_CONTROL, 'b', 10);
	assert_int_equal(lp_send_queue_flush(&queue, fds[1]), -EPIPE);
	assert_int_equal(alive, 2);
	lp_send_queue_clear(&queue);
	assert_int_equal(alive, 0);
	assert_true(lp_send_queue_is_empty(&queue));
	close(fds[1]);
}

static void test_packets_are_taken_whole(void **state)
{
	struct lp_send_queue queue = {0};
	struct lp_packet *packet;

	(void)state;
	put(&queue, LP_PACKET_STATE, 'a', 10);
	put(&queue, LP_PACKET_STATE, 'b', 10);
	put(&queue, LP_PACKET_CONTROL, 'c', 10);
	packet = lp_send_queue_take(&queue);
	assert_int_equal(packet->data[0], 'c');
	lp_packet_drop(packet);
	packet = lp_send_queue_take(&queue);
	assert_int_equal(packet->data[0], 'b'); /* the newest state alone */
	lp_packet_drop(packet);
	assert_null(lp_send_queue_take(&queue));
	assert_true(lp_send_queue_is_empty(&queue));
	assert_int_equal(alive, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_pictures_go_last_and_the_newest_only),
		cmocka_unit_test(test_control_before_state_and_newest_state_only),
		cmocka_unit_test(test_control_queue_is_bounded),
		cmocka_unit_test(test_slow_reader_gets_whole_packets_and_the_newest),
		cmocka_unit_test(test_broken_connection_and_clear),
		cmocka_unit_test(test_packets_are_taken_whole),
	};

	signal(SIGPIPE, SIG_IGN);
	return cmocka_run_group_tests(tests, NULL, NULL);
}

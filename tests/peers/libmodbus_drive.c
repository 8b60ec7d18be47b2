/* A drive behind libmodbus's server: the registers of generic_cia402_modbus, its states, its watchdog, and a handle that
 * a hand leads to and fro by a spring.
 *
 * Usage: libmodbus_drive nagle|nodelay. It prints its port on loopback, and serves one connection after another until
 * it is ended. libmodbus leaves Nagle's algorithm on; `nodelay` turns it off on each connection. When the motor
 * has given torque for some periods, one answer comes late, as from a drive that has something else to do: later than
 * the master waits before it asks again, and sooner than the age of feedback that ends a run.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <math.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { STATUS = 0x100, DEMAND, POSITION, ACTUAL = 0x104, ERROR, FIRST = STATUS };
enum { COMMAND = 0x200, TARGET, MODE, LIMIT, WATCHDOG, SERIAL = 0x306, RATED = 0x308, DISPLAY = 0x30A };
enum { DISABLED = 0x40, READY = 0x21, SWITCHED_ON = 0x23, ENABLED = 0x27, FAULT = 0x08, LOST_MASTER = 0x8130 };

static const double RATED_TORQUE = 0.4, INERTIA = 4e-5, FRICTION = 1e-4; /* N·m, kg·m², N·m·s/rad */
static const double GRIP = 0.019, GRIP_DAMPING = 2.5e-4, REACH = 1.2;    /* N·m/rad, N·m·s/rad, rad */
static const int LATE_ANSWER = 50, LATE = 20000; /* number of the answer, µs */
static const double STEP = 50e-6, COUNTS = 4096 / (2 * M_PI);

static uint16_t *registers; /* of address 0 */
static double angle, speed, advanced, fed, enabled;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

/* The angle to which the hand leads: to and fro from the instant on at which the drive was enabled. */
static double lead(void)
{
    return registers[STATUS] == ENABLED ? 0.5 * REACH * (1 - cos(2 * M_PI * (advanced - enabled))) : 0;
}

/* Move the handle up to an instant, and go to fault when the set-points stay away. */
static void advance(double until)
{
    if (registers[STATUS] == ENABLED && registers[WATCHDOG] && until - fed > 1e-3 * registers[WATCHDOG]) {
        registers[STATUS] = FAULT;
        registers[ERROR] = LOST_MASTER;
        registers[DEMAND] = 0;
    }
    if (until - advanced > 1.0)
        advanced = until; /* nobody asked for long */
    for (; advanced < until; advanced += STEP) {
        double hand = GRIP * (lead() - angle) - GRIP_DAMPING * speed;
        double torque = 1e-3 * RATED_TORQUE * (int16_t)registers[DEMAND];
        speed += STEP * (torque + hand - FRICTION * speed) / INERTIA;
        angle += STEP * speed;
    }
    int32_t counts = lround(angle * COUNTS);
    registers[POSITION] = (uint32_t)counts >> 16;
    registers[POSITION + 1] = counts & 0xFFFF;
    registers[ACTUAL] = registers[DEMAND];
}

static void written(int address, uint16_t value)
{
    if (address == COMMAND && registers[STATUS] != FAULT) {
        int word = value & 0x0F;
        if (word == 0x0F && registers[STATUS] != ENABLED)
            enabled = advanced;
        registers[STATUS] = word == 0x0F ? ENABLED : word == 0x07 ? SWITCHED_ON : word == 0x06 ? READY : DISABLED;
    } else if (address == COMMAND && value & 0x80) {
        registers[STATUS] = DISABLED;
        registers[ERROR] = 0;
    } else if (address == TARGET) {
        fed = advanced;
        registers[TARGET] = value;
    } else if (address == MODE)
        registers[DISPLAY] = value;
    registers[DEMAND] = registers[STATUS] == ENABLED ? registers[TARGET] : 0;
}

static int word(const uint8_t *octets) { return octets[0] << 8 | octets[1]; }

/* Obey what a request writes before libmodbus stores it: function 23 reads what follows from it. */
static void obey(const uint8_t *pdu)
{
    int place = pdu[0] == 23 ? 5 : 1, values = pdu[0] == 6 ? 3 : pdu[0] == 16 ? 6 : 10;
    int count = pdu[0] == 6 ? 1 : pdu[0] == 16 || pdu[0] == 23 ? word(pdu + place + 2) : 0;
    for (int i = 0; i < count; i++)
        written(word(pdu + place) + i, word(pdu + values + 2 * i));
}

int main(int arguments, char **argument)
{
    int one = 1, nodelay = arguments > 1 && !strcmp(argument[1], "nodelay");
    modbus_t *server = modbus_new_tcp("127.0.0.1", 0);
    modbus_mapping_t *mapping = modbus_mapping_new_start_address(0, 0, 0, 0, FIRST, DISPLAY + 1 - FIRST, 0, 0);
    struct sockaddr_in bound;
    socklen_t size = sizeof bound;
    int listening = modbus_tcp_listen(server, 1);
    if (mapping == NULL || listening < 0 || getsockname(listening, (struct sockaddr *)&bound, &size))
        return fprintf(stderr, "%s\n", modbus_strerror(errno)), 1;
    registers = mapping->tab_registers - FIRST;
    registers[STATUS] = DISABLED, registers[LIMIT] = 1000, registers[SERIAL + 1] = 4711, registers[RATED + 1] = 400;
    printf("%d\n", ntohs(bound.sin_port));
    fflush(stdout);
    while (modbus_tcp_accept(server, &listening) >= 0) {
        uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
        int received, answers = 0;
        if (nodelay)
            setsockopt(modbus_get_socket(server), IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
        while ((received = modbus_receive(server, request)) >= 0) {
            advance(now());
            obey(request + modbus_get_header_length(server));
            if (registers[DEMAND] && ++answers == LATE_ANSWER)
                usleep(LATE);
            modbus_reply(server, request, received, mapping);
        }
        modbus_close(server);
    }
    return 1;
}

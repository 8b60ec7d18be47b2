#!/bin/sh
# Process 1 of the guest kernel, which runs one command beside virtual CAN interfaces and then halts. $1 is a folder of
# the host, in which the runner has left `settings` and `command`. Lines on ttyS0 go to the runner: "ready", "failed WHY",
# "unwritten FOLDER", "status NUMBER"; those from it name signals for the command. The end of that file is the end of the
# runner, and of the guest.
job=$1
PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin

mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t tmpfs tmpfs /run
mkdir -p /dev/pts /dev/shm
mount -t devpts devpts /dev/pts
mount -t tmpfs tmpfs /dev/shm
mkdir -m 1777 /run/tmp

stty -F /dev/ttyS0 raw -echo
exec 3<>/dev/ttyS0

off() {
	echo o >/proc/sysrq-trigger
	sleep 60
}

fail() {
	echo "failed $*" >&3
	stty -F /dev/ttyS0 raw # returns when all has been sent
	off
}

# insert FOLDER/NAME: a module of the guest kernel, and what it says when it cannot be had.
insert() {
	for module in "/usr/lib/uml/modules/$(uname -r)/kernel/$1.ko"*; do
		said=$(insmod "$module" 2>&1) || fail "the guest kernel $(uname -r) takes no module $1: $said"
	done
}

# writable FOLDER: of the host, at its own place.
writable() {
	said=$(mount -t hostfs -o "$1" none "$1" 2>&1) || fail "$1 cannot be made writable: $said"
}

# flush FOLDER: the host writes late, and only here it says that it could not.
flush() {
	sync -f "$1" || echo "unwritten $1" >&3
}

for module in net/can/can net/can/can-raw net/can/can-bcm net/can/can-gw drivers/net/can/dev/can-dev \
	drivers/net/can/vcan drivers/net/can/vxcan; do
	insert $module
done
ip link set lo up

. "$job/settings"
each_writable writable
for interface in $interfaces; do
	said=$(ip link add "$interface" type vcan 2>&1 && ip link set "$interface" up 2>&1) || fail "$interface: $said"
done

# Signals for the command, whose process group is that of its first process.
{
	while read -r signal; do kill -s "$signal" -- "-$(cat /run/command.pid)" 2>/dev/null; done
	off
} <&3 &
reader=$!

echo ready >&3
stty -F /dev/tty1 raw -echo
stty -F /dev/tty2 raw -echo
if [ -n "$columns" ]; then
	stty -F /dev/tty1 columns "$columns" rows "$rows" opost onlcr
	setsid sh "$job/command" </dev/null >/dev/tty1 2>&1
	status=$?
	copiers=""
else
	# A program that writes into a pipe must not take it for a terminal.
	mkfifo /run/out /run/err
	cat </run/out >/dev/tty1 &
	copiers=$!
	cat </run/err >/dev/tty2 &
	copiers="$copiers $!"
	setsid sh "$job/command" </dev/null >/run/out 2>/run/err
	status=$?
fi

# What the command has left behind ends with it.
for process in /proc/[0-9]*; do
	case " 1 $$ $reader $copiers " in
	*" ${process#/proc/} "*) ;;
	*) kill -s KILL "${process#/proc/}" 2>/dev/null ;;
	esac
done
for copier in $copiers; do wait "$copier"; done
stty -F /dev/tty1 raw
stty -F /dev/tty2 raw

each_writable flush 2>/dev/null
echo "status $status" >&3
stty -F /dev/ttyS0 raw
off

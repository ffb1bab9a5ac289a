package main

import (
	"fmt"
	"runtime"

	"golang.org/x/sys/unix"
)

const transmitQueue = 10_000 // frames the kernel keeps while we are not scheduled; its 500 overflow under load

// openTap makes TAP device `tap` in the network namespace of process `pid`, brings it up and, when `bridge` is given,
// makes it a port of that bridge. The descriptor works from any namespace.
func openTap(pid int, tap, bridge string) (descriptor int, err error) {
	result := make(chan error)
	go func() { // never unlocked: the thread, which is left in the foreign namespace, ends with this goroutine
		runtime.LockOSThread()
		result <- func() error {
			if err := enter(fmt.Sprintf("/proc/%d/ns/net", pid)); err != nil {
				return fmt.Errorf("pid: the network namespace of %d: %w", pid, err)
			}
			descriptor, err = makeTap(tap, bridge)
			return err
		}()
	}()
	return descriptor, <-result
}

func enter(netns string) error {
	namespace, err := unix.Open(netns, unix.O_RDONLY|unix.O_CLOEXEC, 0)
	if err != nil {
		return err
	}
	defer unix.Close(namespace)
	return unix.Setns(namespace, unix.CLONE_NEWNET)
}

func makeTap(tap, bridge string) (int, error) {
	request, err := unix.NewIfreq(tap)
	if err != nil {
		return -1, fmt.Errorf("tap: %q: %w", tap, err)
	}
	descriptor, err := unix.Open("/dev/net/tun", unix.O_RDWR|unix.O_NONBLOCK|unix.O_CLOEXEC, 0)
	if err != nil {
		return -1, fmt.Errorf("/dev/net/tun: %w", err)
	}
	request.SetUint16(unix.IFF_TAP | unix.IFF_NO_PI)
	if err = unix.IoctlIfreq(descriptor, unix.TUNSETIFF, request); err == nil {
		err = configure(tap, bridge)
	}
	if err != nil {
		unix.Close(descriptor)
		return -1, fmt.Errorf("tap: %q: %w", tap, err)
	}
	return descriptor, nil
}

func configure(tap, bridge string) error {
	socket, err := unix.Socket(unix.AF_INET, unix.SOCK_DGRAM|unix.SOCK_CLOEXEC, 0)
	if err != nil {
		return err
	}
	defer unix.Close(socket)
	queue, _ := unix.NewIfreq(tap)
	queue.SetUint32(transmitQueue)
	if err := unix.IoctlIfreq(socket, unix.SIOCSIFTXQLEN, queue); err != nil {
		return fmt.Errorf("queue length: %w", err)
	}
	if bridge != "" {
		if err := joinBridge(socket, tap, bridge); err != nil {
			return fmt.Errorf("bridge %q: %w", bridge, err)
		}
	}
	flags, _ := unix.NewIfreq(tap)
	if err := unix.IoctlIfreq(socket, unix.SIOCGIFFLAGS, flags); err != nil {
		return err
	}
	flags.SetUint16(flags.Uint16() | unix.IFF_UP)
	return unix.IoctlIfreq(socket, unix.SIOCSIFFLAGS, flags)
}

func joinBridge(socket int, tap, bridge string) error {
	index, _ := unix.NewIfreq(tap)
	if err := unix.IoctlIfreq(socket, unix.SIOCGIFINDEX, index); err != nil {
		return err
	}
	join, err := unix.NewIfreq(bridge)
	if err != nil {
		return err
	}
	join.SetUint32(index.Uint32()) // the kernel reads ifr_ifindex, which shares its place
	return unix.IoctlIfreq(socket, unix.SIOCBRADDIF, join)
}

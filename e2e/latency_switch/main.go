// latency-switch: an Ethernet switch in user space whose delay, jitter, loss, bandwidth and cuts are set per pair of nodes.
//
// One TAP device per node, opened inside the node's network namespace, is a port. Frames are switched by learned MAC
// addresses; broadcast and multicast (DDS discovery) are flooded. Commands come over a unix socket, one JSON object per
// line (control.go). A line `ready` on standard output tells that the socket serves.
package main

import (
	"flag"
	"fmt"
	"log"
	"os"
	"os/signal"
	"runtime"

	"golang.org/x/sys/unix"
)

const (
	niceValue       = -15  // frames must not wait for the busy containers they connect
	timerSlackNanos = 1000 // the kernel may otherwise wake us 50 µs late
)

// The main goroutine forwards frames; it stays on the main thread, which the priority and timer slack below belong to.
func init() { runtime.LockOSThread() }

func main() {
	log.SetFlags(0)
	log.SetPrefix("latency-switch: ")
	control := flag.String("control", "", "path of the unix socket for commands")
	seed := flag.Uint64("seed", 0, "seed of loss and jitter: same seed, same fate of a pair's n-th frame")
	flag.Parse()
	if *control == "" || flag.NArg() > 0 {
		log.Fatal("usage: latency-switch --control SOCKET [--seed N]")
	}
	preferThisThread()
	fabric, err := newFabric(*seed)
	if err != nil {
		log.Fatal(err)
	}
	listener, err := listen(*control)
	if err != nil {
		log.Fatal(err)
	}
	go serve(listener, fabric)
	go stopOnSignal(fabric)
	fmt.Println("ready")
	fabric.run()
	os.Remove(*control)
}

// Both are wishes: without the capability the switch works, only less punctually.
func preferThisThread() {
	if err := unix.Setpriority(unix.PRIO_PROCESS, 0, niceValue); err != nil {
		log.Printf("priority stays normal: %v", err)
	}
	if err := unix.Prctl(unix.PR_SET_TIMERSLACK, timerSlackNanos, 0, 0, 0); err != nil {
		log.Printf("timer slack stays at its default: %v", err)
	}
}

func stopOnSignal(fabric *Fabric) {
	signals := make(chan os.Signal, 1)
	signal.Notify(signals, unix.SIGTERM, unix.SIGINT)
	<-signals
	fabric.do(func() { fabric.stopped = true })
}

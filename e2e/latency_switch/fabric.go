package main

import (
	"fmt"
	"log"
	"maps"
	"slices"
	"strings"
	"sync"

	"golang.org/x/sys/unix"
)

const (
	frameBytes     = 2048   // an Ethernet frame of MTU 1500 with room for tags; longer ones are dropped
	headerBytes    = 14     // two MAC addresses and the type
	framesPerRound = 64     // read from one port before the others and the due frames get their turn
	mostInFlight   = 65_536 // frames: 128 MB
	mostAddresses  = 65_536
)

type Mac [6]byte

func (m Mac) isGroup() bool { return m[0]&1 != 0 }

// Port is a node's TAP device. An open TAP keeps its network namespace alive, so the port ends with the process that
// holds the namespace for the node.
type Port struct {
	name       string
	descriptor int // of the TAP
	holder     int // pidfd
	lost       bool
	links      map[*Port]*Link // from here to there; of the ports attached now
}

// Fabric is all ports and links. Everything in it belongs to the goroutine of run(); others go through do().
type Fabric struct {
	seed     uint64
	ports    []*Port
	names    []string // every node ever attached, sorted: settings outlive a node's crash
	links    map[[2]string]*Link
	learned  map[Mac]*Port
	flights  Flights
	pool     Pool
	totals   Totals
	polled   []unix.PollFd // the wake descriptor, then TAP and holder of each port
	wake     int
	stopped  bool
	guard    sync.Mutex // of commands only
	commands []func()
}

func newFabric(seed uint64) (*Fabric, error) {
	wake, err := unix.Eventfd(0, unix.EFD_NONBLOCK|unix.EFD_CLOEXEC)
	if err != nil {
		return nil, err
	}
	fabric := &Fabric{seed: seed, links: map[[2]string]*Link{}, learned: map[Mac]*Port{}, wake: wake}
	fabric.connect()
	return fabric, nil
}

// do runs `command` between two rounds of forwarding and waits for its end.
func (f *Fabric) do(command func()) {
	done := make(chan struct{})
	f.guard.Lock()
	f.commands = append(f.commands, func() { command(); close(done) })
	f.guard.Unlock()
	if _, err := unix.Write(f.wake, []byte{1, 0, 0, 0, 0, 0, 0, 0}); err != nil {
		log.Fatal("wake: ", err)
	}
	<-done
}

// run forwards frames until stopped.
func (f *Fabric) run() {
	for !f.stopped {
		wait := f.deliverDue()
		if _, err := unix.Ppoll(f.polled, wait, nil); err != nil {
			if err != unix.EINTR {
				log.Fatal("poll: ", err)
			}
			continue
		}
		for at, port := range f.ports {
			tap, holder := f.polled[1+2*at].Revents, f.polled[2+2*at].Revents
			if tap&unix.POLLIN != 0 {
				f.receive(port)
			}
			port.lost = port.lost || holder != 0 || tap&^unix.POLLIN != 0
		}
		if f.polled[0].Revents != 0 {
			f.obey()
		}
		f.dropLost()
	}
}

func (f *Fabric) obey() {
	var count [8]byte
	unix.Read(f.wake, count[:])
	f.guard.Lock()
	commands := f.commands
	f.commands = nil
	f.guard.Unlock()
	for _, command := range commands {
		command()
	}
}

// deliverDue writes what is due and tells how long to wait for the next; nil is for ever.
func (f *Fabric) deliverDue() *unix.Timespec {
	now := clock()
	for len(f.flights.heap) > 0 {
		if ahead := f.flights.heap[0].due - now; ahead > 0 {
			if now = clock(); f.flights.heap[0].due > now {
				wait := unix.NsecToTimespec(f.flights.heap[0].due - now)
				return &wait
			}
			continue
		}
		flight := f.flights.pop()
		f.totals.late(now - flight.due)
		f.write(flight.frame, flight.link, flight.to)
		f.release(flight.frame)
	}
	return nil
}

func (f *Fabric) receive(port *Port) {
	for range framesPerRound {
		frame := f.pool.take()
		size, err := unix.Read(port.descriptor, frame.bytes[:])
		if err != nil || size < headerBytes || size == frameBytes {
			f.pool.give(frame)
			if err == nil {
				f.totals.malformed++
				continue
			}
			port.lost = err != unix.EAGAIN && err != unix.EINTR
			return
		}
		frame.size = size
		f.forward(frame, port)
	}
}

func (f *Fabric) forward(frame *Frame, from *Port) {
	to, source := Mac(frame.bytes[0:6]), Mac(frame.bytes[6:12])
	f.learn(source, from)
	frame.copies = 1 // ours, until all are sent
	now := clock()
	if port, known := f.learned[to]; known && !to.isGroup() {
		if port != from {
			f.send(frame, from, port, now)
		}
	} else {
		for _, port := range f.ports {
			if port != from {
				f.send(frame, from, port, now)
			}
		}
	}
	f.release(frame)
}

func (f *Fabric) learn(source Mac, port *Port) {
	if f.learned[source] == port || source.isGroup() {
		return
	}
	if len(f.learned) >= mostAddresses {
		clear(f.learned) // flooding for a moment is all it costs
	}
	f.learned[source] = port
}

func (f *Fabric) send(frame *Frame, from, to *Port, now int64) {
	link := from.links[to]
	due, fate := link.admit(now, frame.size)
	switch {
	case fate != fateDeliver:
		link.dropped[fate]++
	case due <= now: // a link keeps order, so nothing of it is in flight
		f.write(frame, link, to)
	case len(f.flights.heap) >= mostInFlight:
		f.totals.overflowed++
	default:
		frame.copies++
		f.flights.push(Flight{due: due, link: link, to: to, frame: frame})
	}
}

func (f *Fabric) write(frame *Frame, link *Link, to *Port) {
	if to.lost {
		f.totals.unwritten++
		return
	}
	if _, err := unix.Write(to.descriptor, frame.bytes[:frame.size]); err != nil {
		f.totals.unwritten++
		return
	}
	link.frames++
	link.octets += uint64(frame.size)
}

func (f *Fabric) release(frame *Frame) {
	if frame.copies--; frame.copies == 0 {
		f.pool.give(frame)
	}
}

// attach adds a port; one of the same name is replaced.
func (f *Fabric) attach(port *Port) {
	f.detach(port.name)
	name := port.name
	if at, known := slices.BinarySearch(f.names, name); !known {
		for _, other := range f.names {
			f.links[[2]string{name, other}] = newLink(f.seed, name, other)
			f.links[[2]string{other, name}] = newLink(f.seed, other, name)
		}
		f.names = slices.Insert(f.names, at, name)
	}
	f.ports = append(f.ports, port)
	f.connect()
}

func (f *Fabric) detach(name string) bool {
	for _, port := range f.ports {
		if port.name == name {
			port.lost = true
			f.removeLost()
			return true
		}
	}
	return false
}

// dropLost gives up ports whose node has ended.
func (f *Fabric) dropLost() {
	for _, port := range f.ports {
		if port.lost {
			log.Printf("port of %s is gone", port.name)
			f.totals.portsLost++
			f.removeLost()
			return
		}
	}
}

func (f *Fabric) removeLost() {
	for _, port := range f.ports {
		if port.lost {
			unix.Close(port.descriptor)
			unix.Close(port.holder)
		}
	}
	f.ports = slices.DeleteFunc(f.ports, func(port *Port) bool { return port.lost })
	// Only theirs: whoever stays may not speak for long, and until then all that is sent to it would be flooded.
	maps.DeleteFunc(f.learned, func(_ Mac, port *Port) bool { return port.lost })
	f.connect()
}

// connect rebuilds what the fast path looks up.
func (f *Fabric) connect() {
	f.polled = []unix.PollFd{{Fd: int32(f.wake), Events: unix.POLLIN}}
	for _, port := range f.ports {
		for _, descriptor := range []int{port.descriptor, port.holder} {
			f.polled = append(f.polled, unix.PollFd{Fd: int32(descriptor), Events: unix.POLLIN})
		}
		port.links = map[*Port]*Link{}
		for _, other := range f.ports {
			if other != port {
				port.links[other] = f.links[[2]string{port.name, other.name}]
			}
		}
	}
}

// selected tells the links a command means: one direction, both, or all of a node.
func (f *Fabric) selected(s Selector) ([]*Link, error) {
	if err := f.known(s.nodes()); err != nil {
		return nil, err
	}
	if s.Node != "" {
		var found []*Link
		for pair, link := range f.links {
			if pair[0] == s.Node || pair[1] == s.Node {
				found = append(found, link)
			}
		}
		return found, nil
	}
	if s.From == s.To {
		return nil, fmt.Errorf("a link is between two nodes, not from %q to itself", s.From)
	}
	found := []*Link{f.links[[2]string{s.From, s.To}]}
	if !s.OneWay {
		found = append(found, f.links[[2]string{s.To, s.From}])
	}
	return found, nil
}

func (f *Fabric) known(names []string) error {
	for _, name := range names {
		if !slices.Contains(f.names, name) {
			return fmt.Errorf("no node %q was attached, known are: %s", name, strings.Join(f.names, ", "))
		}
	}
	return nil
}

func clock() int64 {
	var now unix.Timespec
	unix.ClockGettime(unix.CLOCK_MONOTONIC, &now)
	return now.Nano()
}

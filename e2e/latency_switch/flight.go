package main

// Frame is the bytes of one Ethernet frame, shared by all ports it is flooded to.
type Frame struct {
	bytes  [frameBytes]byte
	size   int
	copies int // in flight; back to the pool at 0
}

// Flight is one copy of a frame on its way to a port.
type Flight struct {
	due   int64 // ns, CLOCK_MONOTONIC
	order uint64
	link  *Link
	to    *Port
	frame *Frame
}

func (f *Flight) before(other *Flight) bool {
	return f.due < other.due || (f.due == other.due && f.order < other.order)
}

// Flights is a binary heap, earliest due first. Not container/heap: that one allocates for every frame.
type Flights struct {
	heap  []Flight
	count uint64
}

func (q *Flights) push(flight Flight) {
	q.count++
	flight.order = q.count
	q.heap = append(q.heap, flight)
	at := len(q.heap) - 1
	for at > 0 {
		parent := (at - 1) / 2
		if !q.heap[at].before(&q.heap[parent]) {
			break
		}
		q.heap[at], q.heap[parent] = q.heap[parent], q.heap[at]
		at = parent
	}
}

func (q *Flights) pop() Flight {
	first, last := q.heap[0], len(q.heap)-1
	q.heap[0] = q.heap[last]
	q.heap[last] = Flight{}
	q.heap = q.heap[:last]
	at := 0
	for {
		least := at
		for child := 2*at + 1; child <= 2*at+2 && child < last; child++ {
			if q.heap[child].before(&q.heap[least]) {
				least = child
			}
		}
		if least == at {
			return first
		}
		q.heap[at], q.heap[least] = q.heap[least], q.heap[at]
		at = least
	}
}

// Pool keeps frames for reuse: at 100 000 frames per second the garbage collector would be what delays them.
type Pool struct{ free []*Frame }

func (p *Pool) take() *Frame {
	if last := len(p.free) - 1; last >= 0 {
		frame := p.free[last]
		p.free = p.free[:last]
		return frame
	}
	return &Frame{}
}

func (p *Pool) give(frame *Frame) { p.free = append(p.free, frame) }

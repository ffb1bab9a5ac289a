package main

import (
	"fmt"
	"hash/fnv"
	"math/rand/v2"
)

const defaultBufferMs = 200

// Settings of one direction between two nodes, in the words of the control protocol.
type Settings struct {
	DelayMs  float64 `json:"delay_ms"`
	JitterMs float64 `json:"jitter_ms"` // on top of the delay, uniform in 0..jitter; order is kept
	Loss     float64 `json:"loss"`      // share of frames, 0..1
	MbitS    float64 `json:"mbit_s"`    // 0: unlimited
	BufferMs float64 `json:"buffer_ms"` // what waits longer than this for the bandwidth is dropped
	Down     bool    `json:"down"`
}

// Change is a part of Settings: nil fields stay as they are.
type Change struct {
	DelayMs  *float64 `json:"delay_ms"`
	JitterMs *float64 `json:"jitter_ms"`
	Loss     *float64 `json:"loss"`
	MbitS    *float64 `json:"mbit_s"`
	BufferMs *float64 `json:"buffer_ms"`
	Down     *bool    `json:"down"`
}

// check names the first field that makes no sense.
func (c Change) check() error {
	limits := []struct {
		name  string
		value *float64
		most  float64
	}{
		{"delay_ms", c.DelayMs, 60_000},
		{"jitter_ms", c.JitterMs, 60_000},
		{"loss", c.Loss, 1},
		{"mbit_s", c.MbitS, 1e6},
		{"buffer_ms", c.BufferMs, 60_000},
	}
	for _, limit := range limits {
		if limit.value != nil && !(*limit.value >= 0 && *limit.value <= limit.most) {
			return fmt.Errorf("%s: %v is not between 0 and %v", limit.name, *limit.value, limit.most)
		}
	}
	return nil
}

func (c Change) applyTo(s *Settings) {
	for _, field := range []struct{ from, to *float64 }{
		{c.DelayMs, &s.DelayMs}, {c.JitterMs, &s.JitterMs}, {c.Loss, &s.Loss}, {c.MbitS, &s.MbitS}, {c.BufferMs, &s.BufferMs},
	} {
		if field.from != nil {
			*field.to = *field.from
		}
	}
	if c.Down != nil {
		s.Down = *c.Down
	}
}

// Fate of a frame that enters a link.
type Fate int

const (
	fateDeliver Fate = iota
	fateLost
	fateDown
	fateBuffer
)

// Link is one direction between two nodes: settings, state of its queue, and what happened on it.
type Link struct {
	Settings
	Counters
	random   *rand.Rand
	freeAt   int64 // ns: the limited bandwidth is used up to here
	latestAt int64 // ns: due time of the last frame; a link keeps order
}

func newLink(seed uint64, from, to string) *Link {
	name := fnv.New64a()
	fmt.Fprintf(name, "%s\x00%s", from, to)
	return &Link{
		Settings: Settings{BufferMs: defaultBufferMs},
		random:   rand.New(rand.NewPCG(seed, name.Sum64())),
	}
}

// admit decides when (ns on the clock of `now`) a frame of `size` bytes that enters now comes out, if at all.
// Two random numbers per frame whatever the settings: the n-th frame of a link meets the same luck in every run.
func (l *Link) admit(now int64, size int) (int64, Fate) {
	luck, wobble := l.random.Float64(), l.random.Float64()
	if l.Down {
		return 0, fateDown
	}
	if luck < l.Loss {
		return 0, fateLost
	}
	out := now
	if l.MbitS > 0 {
		start := max(now, l.freeAt)
		if start-now > milliseconds(l.BufferMs) {
			return 0, fateBuffer
		}
		out = start + int64(float64(size*8)*1e3/l.MbitS)
		l.freeAt = out
	}
	out = max(out+milliseconds(l.DelayMs)+int64(wobble*float64(milliseconds(l.JitterMs))), l.latestAt)
	l.latestAt = out
	return out, fateDeliver
}

func milliseconds(value float64) int64 { return int64(value * 1e6) }

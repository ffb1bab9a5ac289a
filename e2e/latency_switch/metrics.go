package main

import (
	"fmt"
	"sort"
	"strings"
)

// Counters of one link.
type Counters struct {
	frames, octets uint64
	dropped        [fateBuffer + 1]uint64
}

var reasons = map[Fate]string{fateLost: "loss", fateDown: "down", fateBuffer: "buffer"}

// Upper bounds of lateness, µs: how long after its due time a delayed frame was written.
var lateBounds = [...]int64{50, 100, 200, 300, 500, 1000, 5000}

// Totals of the whole switch.
type Totals struct {
	malformed, overflowed, unwritten, portsLost uint64
	lateCounts                                  [len(lateBounds) + 1]uint64
	lateNanos                                   int64
}

func (t *Totals) late(nanos int64) {
	t.lateNanos += nanos
	for at, bound := range lateBounds {
		if nanos <= bound*1000 {
			t.lateCounts[at]++
			return
		}
	}
	t.lateCounts[len(lateBounds)]++
}

// exposition is the text of Prometheus' exposition format, version 0.0.4.
func (f *Fabric) exposition() string {
	var text strings.Builder
	f.writeLinks(&text)
	for _, total := range []struct {
		kind, name, help string
		value            uint64
	}{
		{"counter", "malformed_frames_total", "Frames too short or too long to be forwarded.", f.totals.malformed},
		{"counter", "overflowed_frames_total", "Frames dropped because too many were in flight.", f.totals.overflowed},
		{"counter", "unwritten_frames_total", "Frames whose port could not take them.", f.totals.unwritten},
		{"counter", "lost_ports_total", "Ports given up because the process that held their node ended.", f.totals.portsLost},
		{"gauge", "ports", "Ports attached now.", uint64(len(f.ports))},
		{"gauge", "learned_addresses", "MAC addresses known.", uint64(len(f.learned))},
		{"gauge", "frames_in_flight", "Frames delayed just now.", uint64(len(f.flights.heap))},
	} {
		header(&text, total.kind, total.name, total.help)
		fmt.Fprintf(&text, "latency_switch_%s %d\n", total.name, total.value)
	}
	f.totals.writeLate(&text)
	return text.String()
}

func (f *Fabric) writeLinks(text *strings.Builder) {
	pairs := f.pairs()
	header(text, "counter", "frames_total", "Frames delivered from one node to another.")
	for _, pair := range pairs {
		fmt.Fprintf(text, "latency_switch_frames_total{from=%q,to=%q} %d\n", pair[0], pair[1], f.links[pair].frames)
	}
	header(text, "counter", "bytes_total", "Bytes of these frames.")
	for _, pair := range pairs {
		fmt.Fprintf(text, "latency_switch_bytes_total{from=%q,to=%q} %d\n", pair[0], pair[1], f.links[pair].octets)
	}
	header(text, "counter", "dropped_frames_total", "Frames dropped as the link's settings say.")
	for _, pair := range pairs {
		for _, fate := range []Fate{fateLost, fateDown, fateBuffer} {
			fmt.Fprintf(text, "latency_switch_dropped_frames_total{from=%q,to=%q,reason=%q} %d\n",
				pair[0], pair[1], reasons[fate], f.links[pair].dropped[fate])
		}
	}
}

func (t *Totals) writeLate(text *strings.Builder) {
	header(text, "histogram", "late_seconds", "How long after its due time a delayed frame was written.")
	count := uint64(0)
	for at, bound := range lateBounds {
		count += t.lateCounts[at]
		fmt.Fprintf(text, "latency_switch_late_seconds_bucket{le=\"%g\"} %d\n", float64(bound)/1e6, count)
	}
	count += t.lateCounts[len(lateBounds)]
	fmt.Fprintf(text, "latency_switch_late_seconds_bucket{le=\"+Inf\"} %d\n", count)
	fmt.Fprintf(text, "latency_switch_late_seconds_sum %g\nlatency_switch_late_seconds_count %d\n",
		float64(t.lateNanos)/1e9, count)
}

func header(text *strings.Builder, kind, name, help string) {
	fmt.Fprintf(text, "# HELP latency_switch_%s %s\n# TYPE latency_switch_%s %s\n", name, help, name, kind)
}

func (f *Fabric) pairs() [][2]string {
	pairs := make([][2]string, 0, len(f.links))
	for pair := range f.links {
		pairs = append(pairs, pair)
	}
	sort.Slice(pairs, func(a, b int) bool {
		return pairs[a][0] < pairs[b][0] || (pairs[a][0] == pairs[b][0] && pairs[a][1] < pairs[b][1])
	})
	return pairs
}

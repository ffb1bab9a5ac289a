package main

import "testing"

const second = 1_000_000_000

func set(link *Link, change Change) *Link {
	change.applyTo(&link.Settings)
	return link
}

func value(number float64) *float64 { return &number }

func TestDelayAndBandwidthAddUp(t *testing.T) {
	link := set(newLink(1, "a", "b"), Change{DelayMs: value(10), MbitS: value(8)})
	for at, want := range []int64{11_000_000, 12_000_000} { // 1000 bytes take 1 ms at 8 Mbit/s
		if out, fate := link.admit(0, 1000); fate != fateDeliver || out != want {
			t.Errorf("frame %d comes out at %d with fate %d, not at %d", at, out, fate, want)
		}
	}
}

func TestAFullBufferDrops(t *testing.T) {
	link := set(newLink(1, "a", "b"), Change{MbitS: value(8), BufferMs: value(2)})
	fates := []Fate{}
	for range 5 {
		_, fate := link.admit(0, 1000)
		fates = append(fates, fate)
	}
	if fates[2] != fateDeliver || fates[3] != fateBuffer || fates[4] != fateBuffer {
		t.Errorf("fates are %v", fates)
	}
}

func TestALinkKeepsOrderWhateverChanges(t *testing.T) {
	link := set(newLink(1, "a", "b"), Change{DelayMs: value(50), JitterMs: value(20)})
	last := int64(0)
	for frame := range int64(1000) {
		if frame == 500 {
			set(link, Change{DelayMs: value(0)})
		}
		out, _ := link.admit(frame*100_000, 100)
		if out < last || out < frame*100_000 {
			t.Fatalf("frame %d comes out at %d, after %d", frame, out, last)
		}
		last = out
	}
}

func TestTheSameSeedIsTheSameLuckWhateverElseIsSet(t *testing.T) {
	one := set(newLink(7, "a", "b"), Change{Loss: value(0.3)})
	two := set(newLink(7, "a", "b"), Change{Loss: value(0.3), JitterMs: value(5), DelayMs: value(1)})
	other := set(newLink(7, "b", "a"), Change{Loss: value(0.3)})
	lost, different := 0, 0
	for frame := range int64(10_000) {
		_, first := one.admit(frame*second, 100)
		_, alike := two.admit(frame*second, 100)
		_, third := other.admit(frame*second, 100)
		if first != alike {
			t.Fatalf("frame %d: %d and %d", frame, first, alike)
		}
		if first == fateLost {
			lost++
		}
		if first != third {
			different++
		}
	}
	if lost < 2800 || lost > 3200 || different < 3000 {
		t.Errorf("%d lost, %d different from the other direction", lost, different)
	}
}

func TestFlightsComeOutByTimeThenByOrder(t *testing.T) {
	flights := Flights{}
	for at := range int64(1000) {
		flights.push(Flight{due: (at * 7919) % 100})
	}
	last := Flight{due: -1}
	for len(flights.heap) > 0 {
		next := flights.pop()
		if !last.before(&next) {
			t.Fatalf("%d/%d after %d/%d", next.due, next.order, last.due, last.order)
		}
		last = next
	}
}

func TestWhatMakesNoSenseIsNamed(t *testing.T) {
	for name, change := range map[string]Change{
		"loss: 2 is not between 0 and 1": {Loss: value(2)}, "delay_ms: -1 is not between 0 and 60000": {DelayMs: value(-1)},
	} {
		if err := change.check(); err == nil || err.Error() != name {
			t.Errorf("%v, not %s", err, name)
		}
	}
}

package main

import (
	"bufio"
	"bytes"
	"encoding/json"
	"errors"
	"fmt"
	"log"
	"net"
	"os"

	"golang.org/x/sys/unix"
)

const mostLineBytes = 1 << 20

// Selector says which links a change is for: from one node to another (and back unless one way), or all of one node.
type Selector struct {
	From   string `json:"from"`
	To     string `json:"to"`
	OneWay bool   `json:"one_way"`
	Node   string `json:"node"`
}

func (s Selector) nodes() []string {
	if s.Node != "" {
		return []string{s.Node}
	}
	return []string{s.From, s.To}
}

type linkChange struct {
	Selector
	Change
}

// request is one line. `op`: set (links), get, metrics, attach (node, pid, tap, bridge), detach (node).
type request struct {
	Op     string       `json:"op"`
	Links  []linkChange `json:"links"`
	Node   string       `json:"node"`
	Pid    int          `json:"pid"`
	Tap    string       `json:"tap"`
	Bridge string       `json:"bridge"`
}

// linkState is one entry of the answer to `get`.
type linkState struct {
	From string `json:"from"`
	To   string `json:"to"`
	Settings
}

type answer struct {
	Ok      bool        `json:"ok"`
	Error   string      `json:"error,omitempty"`
	Nodes   []string    `json:"nodes,omitempty"` // attached now
	Links   []linkState `json:"links,omitempty"`
	Metrics string      `json:"metrics,omitempty"`
}

// listen makes the socket, for its owner only, in the place of one that a killed switch left.
func listen(path string) (net.Listener, error) {
	if err := os.Remove(path); err != nil && !errors.Is(err, os.ErrNotExist) {
		return nil, err
	}
	listener, err := net.Listen("unix", path)
	if err != nil {
		return nil, err
	}
	return listener, os.Chmod(path, 0o600)
}

func serve(listener net.Listener, fabric *Fabric) {
	for {
		connection, err := listener.Accept()
		if err != nil {
			log.Fatal("control socket: ", err)
		}
		go converse(connection, fabric)
	}
}

func converse(connection net.Conn, fabric *Fabric) {
	defer connection.Close()
	lines := bufio.NewScanner(connection)
	lines.Buffer(nil, mostLineBytes)
	answers := json.NewEncoder(connection)
	for lines.Scan() {
		reply, err := fabric.execute(lines.Bytes())
		if err != nil {
			reply = answer{Error: err.Error()}
		}
		reply.Ok = err == nil
		if answers.Encode(reply) != nil {
			return // the caller went away
		}
	}
}

func (f *Fabric) execute(line []byte) (reply answer, err error) {
	var command request
	decoder := json.NewDecoder(bytes.NewReader(line))
	decoder.DisallowUnknownFields()
	if err := decoder.Decode(&command); err != nil {
		return reply, err
	}
	switch command.Op {
	case "set":
		f.do(func() { err = f.set(command.Links) })
	case "get":
		f.do(func() { reply.Nodes, reply.Links = f.state() })
	case "metrics":
		f.do(func() { reply.Metrics = f.exposition() })
	case "attach":
		err = f.plugIn(command)
	case "detach":
		found := false
		f.do(func() { found = f.detach(command.Node) })
		if !found {
			err = fmt.Errorf("node: %q is not attached", command.Node)
		}
	default:
		err = fmt.Errorf("op: %q is none of set, get, metrics, attach, detach", command.Op)
	}
	return reply, err
}

// set applies all changes or, when one is wrong, none.
func (f *Fabric) set(changes []linkChange) error {
	targets := make([][]*Link, len(changes))
	for at, change := range changes {
		links, err := f.selected(change.Selector)
		if err == nil {
			err = change.check()
		}
		if err != nil {
			return fmt.Errorf("links[%d]: %w", at, err)
		}
		targets[at] = links
	}
	for at, change := range changes {
		for _, link := range targets[at] {
			change.applyTo(&link.Settings)
		}
	}
	return nil
}

func (f *Fabric) state() (nodes []string, links []linkState) {
	for _, port := range f.ports {
		nodes = append(nodes, port.name)
	}
	for _, pair := range f.pairs() {
		links = append(links, linkState{From: pair[0], To: pair[1], Settings: f.links[pair].Settings})
	}
	return nodes, links
}

func (f *Fabric) plugIn(command request) error {
	if command.Node == "" {
		return errors.New("node: a port needs a name")
	}
	f.do(func() { f.detach(command.Node) }) // the device of the same name must be closed before it can be opened
	holder, err := unix.PidfdOpen(command.Pid, 0)
	if err != nil {
		return fmt.Errorf("pid: %d: %w", command.Pid, err)
	}
	descriptor, err := openTap(command.Pid, command.Tap, command.Bridge)
	if err != nil {
		unix.Close(holder)
		return err
	}
	f.do(func() { f.attach(&Port{name: command.Node, descriptor: descriptor, holder: holder}) })
	return nil
}
